//! Asks a Python for its version and for those of packages.

#![allow(clippy::disallowed_methods, reason = "a deadline says when an answer is too late; no result holds a time")]

use std::{
    collections::BTreeMap,
    io,
    path::Path,
    time::{Duration, Instant},
};

use crate::child::{Child, Log};

/// Prints the version of Python and of each package that is named, or `null`.
const VERSIONS: &str = "
import importlib.metadata, json, sys
def version(name):
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return None
print(json.dumps({'python': sys.version.split()[0], **{name: version(name) for name in sys.argv[1:]}}))
";
/// How long that may take.
const PATIENCE: Duration = Duration::from_secs(60);
/// The most bytes of what it prints.
const LONGEST: usize = 1 << 20;

/// Why there is no answer.
#[derive(Debug)]
pub enum NoAnswer {
    /// The interpreter cannot be started.
    System(io::Error),
    /// It does not have this package.
    Missing(String),
    /// It says something else.
    Other {
        /// Whether it ended with exit status 0.
        succeeded: bool,
        /// The last lines of its standard error.
        last_words: Vec<String>,
    },
}

/// The versions of Python, under the name `python`, and of packages, as an interpreter finds them in a folder.
///
/// # Errors
/// There is no answer.
pub fn versions(
    interpreter: &[String],
    packages: impl IntoIterator<Item = String>,
    folder: &Path,
) -> Result<BTreeMap<String, String>, NoAnswer> {
    let mut command = interpreter.to_vec();
    command.extend(["-c".to_owned(), VERSIONS.to_owned()]);
    command.extend(packages);
    let mut child = Child::start(&command, folder, Log::default()).map_err(NoAnswer::System)?;
    let deadline = Instant::now() + PATIENCE;
    let (mut text, mut byte) = (Vec::new(), [0]);
    while text.len() < LONGEST && child.read(&mut byte, deadline).is_ok() && byte != *b"\n" {
        text.push(byte[0]);
    }
    let told: Result<BTreeMap<String, Option<String>>, _> = serde_json::from_slice(&text);
    let told = told.map_err(|_| NoAnswer::Other {
        succeeded: child.end().is_some_and(|status| status.success()),
        last_words: child.last_words(),
    })?;
    told.into_iter()
        .map(|(name, version)| version.map(|it| (name.clone(), it)).ok_or(NoAnswer::Missing(name)))
        .collect()
}
