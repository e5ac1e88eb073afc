//! The files of a result, in memory or on disk.

use std::{borrow::Cow, collections::BTreeMap, fs, path::PathBuf};

use super::{
    Result,
    error::{OrIo as _, Problem},
};

/// What a file holds.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Content {
    /// The bytes themselves.
    Bytes(Vec<u8>),
    /// A file that holds the bytes. A store that publishes it takes the file over; an input that was loaded is the
    /// store's own file, which must only be read.
    File(PathBuf),
}

impl Content {
    /// The bytes; read from disk where they lie in a file.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn bytes(&self) -> Result<Cow<'_, [u8]>> {
        match self {
            Self::Bytes(bytes) => Ok(Cow::Borrowed(bytes)),
            Self::File(path) => fs::read(path).map(Cow::Owned).or_io(|| format!("cannot read {}", path.display())),
        }
    }
}

impl From<Vec<u8>> for Content {
    fn from(bytes: Vec<u8>) -> Self {
        Self::Bytes(bytes)
    }
}

/// The files of one result by name, in the order of their names.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Files(BTreeMap<String, Content>);

impl Files {
    /// No files.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a file, or replaces the one of that name.
    pub fn insert(&mut self, name: impl Into<String>, content: impl Into<Content>) {
        self.0.insert(name.into(), content.into());
    }

    /// The content of a file.
    pub fn get(&self, name: &str) -> Option<&Content> {
        self.0.get(name)
    }

    /// The bytes of a file.
    ///
    /// # Errors
    /// There is no such file, or it cannot be read.
    pub fn bytes(&self, name: &str) -> Result<Cow<'_, [u8]>> {
        match self.get(name) {
            Some(content) => content.bytes(),
            None => Err(Problem::Gone.of(name)),
        }
    }

    /// Every file, in the order of the names.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &Content)> {
        self.0.iter().map(|(name, content)| (name.as_str(), content))
    }

    /// The names of all files, in order.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.0.keys().map(String::as_str)
    }

    /// Takes a file out.
    pub fn remove(&mut self, name: &str) -> Option<Content> {
        self.0.remove(name)
    }

    /// How many files there are.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether there are no files.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

impl<N: Into<String>, C: Into<Content>, const COUNT: usize> From<[(N, C); COUNT]> for Files {
    fn from(files: [(N, C); COUNT]) -> Self {
        files.into_iter().collect()
    }
}

impl<N: Into<String>, C: Into<Content>> FromIterator<(N, C)> for Files {
    fn from_iter<I: IntoIterator<Item = (N, C)>>(files: I) -> Self {
        Self(files.into_iter().map(|(name, content)| (name.into(), content.into())).collect())
    }
}
