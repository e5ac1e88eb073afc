//! Looks at the program of an environment while a pipeline is read: its files, the versions of its packages, and what it
//! says of itself.
//!
//! To start an environment may take a second. So what it says is kept in a cache, under a digest of everything that is in
//! the key. `status` and `dag` then start no environment.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

use serde_json::json;

use super::{
    connection::{Connection, Failed},
    program::{Found, Program},
    wire::About,
};
use crate::{
    digest::Digest,
    python::{self, NoAnswer},
};

/// A value of `[task]` that cannot be used.
#[derive(Debug)]
pub struct Unusable {
    /// Its key.
    pub key: &'static str,
    /// A lower-case clause.
    pub why: String,
}

impl Program {
    /// The program with all that is found in a folder.
    ///
    /// # Errors
    /// Why no environment can run.
    pub fn look(self, folder: &Path) -> Result<Self, Unusable> {
        let in_one_line = |error: &anyhow::Error| error.downcast_ref().map(Failed::in_one_line);
        let unusable = |key, error: anyhow::Error| {
            let why = in_one_line(&error).unwrap_or_else(|| format!("{error:#}"));
            Unusable { key, why }
        };
        let folder = fs::canonicalize(folder).unwrap_or_else(|_| folder.to_owned());
        let program = Self { folder: Some(folder), ..self };
        let files = program.digests().map_err(|error| unusable("files", error))?;
        let versions = versions(&program).map_err(|error| unusable("packages", error))?;
        let cache = cache_file(&program, &files, &versions);
        let known = cache.as_ref().and_then(|file| serde_json::from_slice(&fs::read(file).ok()?).ok());
        let about = match known.filter(|about: &About| about.mistake().is_none()) {
            Some(about) => about,
            None => {
                let connection =
                    Connection::open(&program, program.log()).map_err(|error| unusable("command", error))?;
                let about = connection.about().clone();
                cache.into_iter().for_each(|file| keep(&file, &about));
                about
            }
        };
        Ok(Self { found: Some(Found { files, versions, about }), ..program })
    }
}

/// Removes what the cache knows of a program.
pub(super) fn forget(program: &Program) {
    let file = program.found.as_ref().and_then(|found| cache_file(program, &found.files, &found.versions));
    file.into_iter().for_each(|file| _ = fs::remove_file(file));
}

/// Where the cache keeps what a program says of itself; `None` where the user has no folder for caches.
fn cache_file(
    program: &Program,
    files: &BTreeMap<String, Digest>,
    versions: &BTreeMap<String, String>,
) -> Option<PathBuf> {
    let of_user = |name: &str| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let caches = of_user("XDG_CACHE_HOME").or_else(|| Some(of_user("HOME")?.join(".cache")))?;
    // Without files, an edit of the program would go unseen.
    let is_safe = !files.is_empty();
    let Program { command, options, folder, .. } = program;
    let digest = Digest::of_json(&json!([command, options, folder, files, versions]));
    is_safe.then(|| caches.join("carl-pipe").join("environments").join(format!("{}.json", digest.hex())))
}

/// Writes to the cache. A cache that cannot be written saves nothing.
fn keep(file: &Path, about: &About) {
    let folder = file.parent().unwrap_or(Path::new(""));
    let write = || -> std::io::Result<()> {
        fs::create_dir_all(folder)?;
        let mut new = tempfile::NamedTempFile::new_in(folder)?;
        serde_json::to_writer(&mut new, about)?;
        new.persist(file).map_err(|error| error.error)?;
        Ok(())
    };
    _ = write();
}

/// The versions of Python and of the packages; none where the command names no Python.
fn versions(program: &Program) -> anyhow::Result<BTreeMap<String, String>> {
    let Some(interpreter) = interpreter(&program.command) else {
        anyhow::ensure!(
            program.packages.is_empty(),
            "they need a Python in `command`, before a file whose name ends in `.py`"
        );
        return Ok(BTreeMap::new());
    };
    let shown = interpreter.join(" ");
    python::versions(interpreter, program.packages.iter().cloned(), program.folder()?).map_err(|error| match error {
        NoAnswer::Missing(name) => anyhow::anyhow!("`{shown}` does not have `{name}`"),
        NoAnswer::System(error) => anyhow::anyhow!("cannot ask `{shown}` for versions: {error}"),
        NoAnswer::Other { last_words, .. } => {
            anyhow::anyhow!("cannot ask `{shown}` for versions: {}", last_words.join("; "))
        }
    })
}

/// The words of a command that start Python: those before the program's file.
fn interpreter(command: &[String]) -> Option<&[String]> {
    let file = command.iter().position(|word| word == "-m" || word.ends_with(".py"))?;
    let words = &command[..file];
    let name = Path::new(words.iter().rfind(|word| !word.starts_with('-'))?).file_name()?;
    name.to_string_lossy().starts_with("python").then_some(words)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn python_is_what_stands_before_its_file() {
        let of = |line: &str| {
            let words: Vec<String> = line.split(' ').map(str::to_owned).collect();
            interpreter(&words).map(|words| words.join(" "))
        };
        assert_eq!(of("python3 my_env.py --fast").as_deref(), Some("python3"));
        assert_eq!(of("nice /usr/bin/python3.11 -u my_env.py").as_deref(), Some("nice /usr/bin/python3.11 -u"));
        assert_eq!(of("uv run python -m my.env").as_deref(), Some("uv run python"));
        assert_eq!(of("./my_env.py"), None);
        assert_eq!(of("./my_env"), None);
    }
}
