//! What lies around a pipeline file on this machine: files, Python packages and variables of the environment.

use std::{
    cell::RefCell,
    collections::BTreeMap,
    env,
    path::{Path, PathBuf},
    process::{Command, Stdio},
};

use super::out;
use crate::{digest::Digest, stage::Outside};

/// Prints the versions of Python and of the packages named as JSON. A package that is missing is named alone.
const VERSIONS: &str = "
import importlib.metadata, json, platform, sys
found = {'python': platform.python_version()}
for name in sys.argv[1:]:
    try:
        found[name] = importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        if name != 'python':
            sys.exit(f'`{name}` is not installed')
print(json.dumps(found))
";

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
    let mut command = Command::new(python);
    command.args(["-c", VERSIONS]).args(names).stdin(Stdio::null());
    let ended = command.output().map_err(|error| format!("`{python}`: {}", out::tidy(&error.to_string())))?;
    if !ended.status.success() {
        let said = String::from_utf8_lossy(&ended.stderr);
        let last = said.lines().last().unwrap_or("it says nothing");
        return Err(format!("`{python}`: {last}"));
    }
    serde_json::from_slice(&ended.stdout).map_err(|_| format!("`{python}` is no Python interpreter"))
}
