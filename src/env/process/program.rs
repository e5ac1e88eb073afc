//! `[task]` of an environment in another process: what a file writes, and what was found when the file was read.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use anyhow::Context as _;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

use super::wire::About;
use crate::{child::Log, digest::Digest, env::Spec};

/// The program of an environment, with its options.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Program {
    /// The program and its arguments. It runs in the folder of the file that names it.
    pub command: Vec<String>,
    /// What the program gets as options.
    #[serde(default)]
    pub options: Map<String, Value>,
    /// The program's own files, from that folder. Their content is in the key.
    #[serde(default)]
    pub files: Vec<String>,
    /// Python packages. Their versions and that of Python are in the key.
    #[serde(default)]
    pub packages: Vec<String>,
    /// Seconds within which the program must answer. It changes no result, so it is in no key.
    #[serde(default = "usual_timeout")]
    pub timeout: f64,
    /// The folder in which the program runs. It is in no key.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub folder: Option<PathBuf>,
    /// What was found when the file was read.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub found: Option<Found>,
    /// Its standard error.
    #[serde(skip)]
    pub(super) log: Log,
}

fn usual_timeout() -> f64 {
    60.0
}

/// What the program was when the pipeline was read. All of it is in the key.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Found {
    /// The content of its files.
    pub files: BTreeMap<String, Digest>,
    /// The versions of Python and of the packages.
    pub versions: BTreeMap<String, String>,
    /// What the environment says of itself.
    pub about: About,
}

/// Keys that manifests hold beside those of [`fields`].
pub const MEMORY: [&str; 2] = ["folder", "found"];

/// The keys of `[task]` that describe a program, each with the JSON schema of its value.
pub fn fields() -> [(&'static str, Value); 5] {
    let texts = json!({ "type": "array", "items": { "type": "string" } });
    [
        ("command", texts.clone()),
        ("options", json!({ "type": "object" })),
        ("files", texts.clone()),
        ("packages", texts),
        ("timeout", json!({ "type": "number" })),
    ]
}

impl Program {
    /// Its values that cannot be used: the key and a lower-case clause.
    pub fn refusals(&self) -> Vec<(&'static str, String)> {
        let mut refusals = Vec::new();
        if self.command.is_empty() {
            refusals.push(("command", "names no program".to_owned()));
        }
        if !(self.timeout > 0.0 && self.timeout <= 86_400.0) {
            refusals.push(("timeout", format!("must be above 0 and at most 86400 s, but is `{}`", self.timeout)));
        }
        refusals
    }

    /// The part of the task that is in keys.
    pub fn in_key(&self) -> Map<String, Value> {
        let Self { command, options, found, .. } = self;
        let json = json!({ "command": command, "options": options, "found": found });
        json.as_object().cloned().unwrap_or_default()
    }

    /// The same program, with a log of its own.
    #[must_use]
    pub fn with_own_log(&self) -> Self {
        Self { log: Log::default(), ..self.clone() }
    }

    /// The lines of standard error of the processes of this program.
    pub fn log(&self) -> Log {
        self.log.clone()
    }

    /// What the stages are told.
    ///
    /// # Panics
    /// If nobody has looked at the program yet.
    pub fn spec(&self) -> Spec {
        self.found.as_ref().expect("a task is looked at before it is used").about.spec()
    }

    /// The folder in which the program runs.
    ///
    /// # Errors
    /// It is not known.
    pub fn folder(&self) -> anyhow::Result<&Path> {
        self.folder.as_deref().context("the folder of the environment's program is not known")
    }

    /// The digests of its files.
    ///
    /// # Errors
    /// The name of a file that cannot be read, with the reason.
    pub(super) fn digests(&self) -> anyhow::Result<BTreeMap<String, Digest>> {
        let folder = self.folder()?;
        let digest = |name: &String| {
            let file = std::fs::File::open(folder.join(name)).with_context(|| format!("cannot read `{name}`"))?;
            let digest = Digest::of_reader(file).with_context(|| format!("cannot read `{name}`"))?;
            Ok((name.clone(), digest))
        };
        // A file that the command names is the program's, too.
        let is_own = |word: &&String| Path::new(word).is_relative() && folder.join(word).is_file();
        self.files.iter().chain(self.command.iter().filter(is_own)).map(digest).collect()
    }

    /// Refuses files that have changed since the pipeline was read.
    pub(super) fn must_be_unchanged(&self) -> anyhow::Result<()> {
        let (now, found) = (self.digests()?, self.found.as_ref());
        let changed = now.iter().find(|(name, digest)| found.is_some_and(|it| it.files.get(*name) != Some(digest)));
        let folder = self.folder()?.display();
        changed.map_or(Ok(()), |(name, _)| {
            anyhow::bail!("`{name}` in `{folder}` is not the file that the run was planned with")
        })
    }

    /// Refuses an environment that describes itself in another way than when the pipeline was read.
    pub(super) fn must_match(&self, now: &About) -> anyhow::Result<()> {
        let is_same = self.found.as_ref().is_none_or(|found| found.about == *now);
        if !is_same {
            super::look::forget(self);
        }
        anyhow::ensure!(
            is_same,
            "the environment describes itself in another way than before: name every file of the program in `files`, and \
             its packages in `packages`"
        );
        Ok(())
    }
}
