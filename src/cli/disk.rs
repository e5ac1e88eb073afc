//! What lies around a pipeline file on this machine: files, Python packages and variables of the environment.

use std::{
    cell::RefCell,
    collections::BTreeMap,
    env,
    path::{Path, PathBuf},
};

use super::out;
use crate::{
    digest::Digest,
    python::{self, NoAnswer},
    stage::Outside,
};

/// An interpreter, and the packages that were asked for.
type Question = (String, Vec<String>);

/// The versions that it found, or why it found none.
type Answer = Result<BTreeMap<String, String>, String>;

/// The surroundings of a pipeline file. Each file and interpreter is asked once.
#[derive(Debug)]
pub(super) struct Disk<'a> {
    folder: &'a Path,
    digests: RefCell<BTreeMap<PathBuf, Result<Digest, String>>>,
    versions: RefCell<BTreeMap<Question, Answer>>,
}

impl<'a> Disk<'a> {
    /// The surroundings of a file in this folder.
    pub(super) fn new(folder: &'a Path) -> Self {
        Self { folder, digests: RefCell::default(), versions: RefCell::default() }
    }

    /// The files that were looked at.
    pub(super) fn into_seen(self) -> impl Iterator<Item = PathBuf> {
        self.digests.into_inner().into_keys()
    }
}

impl Outside for Disk<'_> {
    fn digest(&self, path: &str) -> Result<Digest, String> {
        let path = self.place(path);
        let read = |path: &PathBuf| Digest::of_path(path).map_err(|error| out::tidy(&error.to_string()));
        self.digests.borrow_mut().entry(path).or_insert_with_key(read).clone()
    }

    fn place(&self, path: &str) -> PathBuf {
        self.folder.join(path)
    }

    fn packages(&self, python: &str, names: &[String]) -> Answer {
        let ask = |(python, names): &Question| versions(python, names);
        self.versions.borrow_mut().entry((python.to_owned(), names.to_vec())).or_insert_with_key(ask).clone()
    }

    fn variable(&self, name: &str) -> Option<String> {
        env::var(name).ok()
    }
}

fn versions(python: &str, names: &[String]) -> Answer {
    // `python` may stand among the packages, and is told anyway.
    let packages = names.iter().filter(|name| *name != "python").cloned();
    let why = match python::versions(&[python.to_owned()], packages, Path::new(".")) {
        Ok(versions) => return Ok(versions),
        Err(NoAnswer::System(error)) => out::tidy(&error.to_string()),
        Err(NoAnswer::Missing(name)) => format!("`{name}` is not installed"),
        Err(NoAnswer::Other { succeeded: true, .. }) => return Err(format!("`{python}` is no Python interpreter")),
        Err(NoAnswer::Other { last_words, .. }) => {
            last_words.last().map_or("it says nothing", String::as_str).to_owned()
        }
    };
    Err(format!("`{python}`: {why}"))
}
