//! The files of one reading.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use crate::{
    diag::{Sources, Span},
    digest::Digest,
    stage::Outside,
};

/// A file in memory.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Source {
    /// The path as messages show it.
    pub path: String,
    /// The content.
    pub bytes: Vec<u8>,
    /// The folder in which the file lies. A text without one can name no program.
    pub folder: Option<PathBuf>,
}

impl Source {
    /// A file in memory.
    pub fn new(path: impl Into<String>, bytes: impl Into<Vec<u8>>) -> Self {
        Self { path: path.into(), bytes: bytes.into(), folder: None }
    }

    /// The same file, which lies in a folder.
    #[must_use]
    pub fn in_folder(self, folder: &Path) -> Self {
        // The parent of a bare name is the empty path.
        let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
        Self { folder: Some(folder.to_owned()), ..self }
    }
}

/// Reads a file that another file names. The path counts from the folder of the file that was loaded.
///
/// # Errors
/// The reason in words, such as `No such file or directory`.
pub type Reader<'a> = &'a dyn Fn(&str) -> Result<Source, String>;

/// Reads files, and keeps the texts that mistakes are shown in.
pub(super) struct Files<'r> {
    pub(super) sources: Sources,
    read: Reader<'r>,
    pub(super) outside: &'r dyn Outside,
    known: Vec<File>,
}

/// A file, read.
#[derive(Debug, Clone)]
pub(super) struct File {
    /// The path as messages show it.
    pub(super) path: String,
    pub(super) bytes: Vec<u8>,
    /// Where its places begin.
    pub(super) base: usize,
    /// Its folder on the disk, if it has one.
    pub(super) home: Option<PathBuf>,
    /// Its folder, from the folder of the file that was loaded.
    folder: String,
}

impl File {
    /// The start of the file: the place of what the file lacks.
    pub(super) fn start(&self) -> Span {
        self.base..self.base
    }

    pub(super) fn text(&self) -> String {
        String::from_utf8_lossy(&self.bytes).into_owned()
    }

    /// A path from this file's folder, as the reader takes it.
    pub(super) fn beside(&self, path: &str) -> String {
        Path::new(&self.folder).join(path).to_string_lossy().into_owned()
    }
}

impl<'r> Files<'r> {
    pub(super) fn new(read: Reader<'r>, outside: &'r dyn Outside) -> Self {
        Self { sources: Sources::default(), read, outside, known: Vec::new() }
    }

    /// Reads a file. A file that was read before keeps its places.
    pub(super) fn read(&mut self, path: &str) -> Result<File, String> {
        let source = (self.read)(path)?;
        let known = self.known.iter().find(|file| file.path == source.path && file.bytes == source.bytes);
        if let Some(file) = known {
            return Ok(file.clone());
        }
        let folder = Path::new(path).parent().unwrap_or(Path::new("")).to_string_lossy().into_owned();
        Ok(self.add(&source, &folder))
    }

    /// Adds a file that is read already.
    pub(super) fn add(&mut self, source: &Source, folder: &str) -> File {
        let base = self.sources.add(source.path.as_str(), String::from_utf8_lossy(&source.bytes));
        let (path, bytes, home) = (source.path.clone(), source.bytes.clone(), source.folder.clone());
        let file = File { path, bytes, base, home, folder: folder.to_owned() };
        self.known.push(file.clone());
        file
    }
}

/// What lies outside, as a file of a suite names it: from its own folder.
pub(super) struct Beside<'a> {
    pub(super) file: &'a File,
    pub(super) outside: &'a dyn Outside,
}

impl Outside for Beside<'_> {
    fn digest(&self, path: &str) -> Result<Digest, String> {
        self.outside.digest(&self.file.beside(path))
    }

    fn place(&self, path: &str) -> PathBuf {
        self.outside.place(&self.file.beside(path))
    }

    fn packages(&self, python: &str, names: &[String]) -> Result<BTreeMap<String, String>, String> {
        self.outside.packages(python, names)
    }

    fn variable(&self, name: &str) -> Option<String> {
        self.outside.variable(name)
    }
}
