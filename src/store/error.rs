//! What can go wrong with a store.

use std::{io, path::PathBuf};

use serde::Serialize;

/// What a store cannot do, by what a caller may do about it.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// Another process holds the store; trying again later may succeed.
    #[error("{0}")]
    Busy(String),
    /// The folder holds something else, so nothing is written to it.
    #[error("{} is not a store of carl-pipe: {why}; give a store or an empty folder with `--artifacts`", folder.display())]
    NotAStore {
        /// The folder.
        folder: PathBuf,
        /// What it has instead, such as `it has files but no store.json`.
        why: &'static str,
    },
    /// Another version of carl-pipe made the store.
    #[error(
        "{} is a store of format {found}, but this carl-pipe reads format {supported}; give another folder with `--artifacts`",
        folder.display()
    )]
    OtherFormat {
        /// The folder of the store.
        folder: PathBuf,
        /// The format that it has.
        found: u64,
        /// The format that this program reads.
        supported: u64,
    },
    /// A file that an entry names cannot be used; making its result again mends it.
    #[error("its {file} is {problem}")]
    Unusable {
        /// The name of the file in its result.
        file: String,
        /// What is wrong with it.
        problem: Problem,
    },
    /// The system refused an operation.
    #[error("{action}")]
    Io {
        /// What failed, with the path: `cannot write artifacts/objects/9f/…`.
        action: String,
        /// Why.
        source: io::Error,
    },
}

/// The result of an operation on a store.
pub type Result<T> = std::result::Result<T, Error>;

/// Why an object that an entry names cannot be used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Problem {
    /// The object is missing.
    Gone,
    /// The bytes of the object do not have its digest. The store has set the object aside.
    Damaged,
}

impl Problem {
    /// The error that a file of a result has this problem.
    pub(super) fn of(self, file: &str) -> Error {
        Error::Unusable { file: file.to_owned(), problem: self }
    }
}

impl std::fmt::Display for Problem {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Gone => "gone",
            Self::Damaged => "damaged",
        })
    }
}

/// Names the operation that the system refused.
pub(super) trait OrIo<T> {
    /// Adds `action`, a clause such as `cannot read FILE`.
    fn or_io(self, action: impl FnOnce() -> String) -> Result<T>;
}

impl<T, E: Into<io::Error>> OrIo<T> for std::result::Result<T, E> {
    fn or_io(self, action: impl FnOnce() -> String) -> Result<T> {
        self.map_err(|source| Error::Io { action: action(), source: source.into() })
    }
}
