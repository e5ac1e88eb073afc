//! What lies outside of a pipeline file and yet changes results: files, packages and variables that parameters name.

use std::{collections::BTreeMap, path::PathBuf};

use crate::digest::Digest;

/// Looks at what lies outside of a pipeline file, while the file is read. Paths count from the folder of the file.
///
/// The errors are reasons in words, such as `No such file or directory`.
pub trait Outside {
    /// The digest of the content of a file.
    ///
    /// # Errors
    /// The file cannot be read.
    fn digest(&self, path: &str) -> Result<Digest, String>;

    /// Where a file lies on this machine.
    fn place(&self, path: &str) -> PathBuf;

    /// The versions of Python and of packages, as the interpreter `python` finds them.
    ///
    /// # Errors
    /// There is no such interpreter, or a package is not installed.
    fn packages(&self, python: &str, names: &[String]) -> Result<BTreeMap<String, String>, String>;

    /// The value of a variable of the environment; `None` if it is not set, or no text.
    fn variable(&self, name: &str) -> Option<String>;
}

/// A file that the parameters of a stage name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NamedFile {
    /// Its path from the folder of the pipeline file.
    pub path: String,
    /// The digest of its content.
    pub content: Digest,
}

/// A place from which nothing outside can be seen: for pipeline files that name nothing.
#[derive(Debug, Clone, Copy)]
pub struct NothingOutside;

impl Outside for NothingOutside {
    fn digest(&self, _: &str) -> Result<Digest, String> {
        Err("no file can be read here".to_owned())
    }

    fn place(&self, path: &str) -> PathBuf {
        PathBuf::from(path)
    }

    fn packages(&self, _: &str, _: &[String]) -> Result<BTreeMap<String, String>, String> {
        Err("no program can be asked here".to_owned())
    }

    fn variable(&self, _: &str) -> Option<String> {
        None
    }
}
