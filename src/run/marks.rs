//! What a user says about a run: a pin, a note and tags. They lie beside the manifest, which nothing changes once the
//! run has ended.

use std::{fs, io, path::Path};

use anyhow::{Context as _, bail};
use serde::{Deserialize, Serialize};

use super::runs;
use crate::store::{
    self,
    sealed::{self, Seal},
};

/// The file in the folder of a run.
const FILE: &str = "marks.json";

/// What a user says about a run.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Marks {
    /// Whether `gc` never removes the run.
    pub pinned: bool,
    /// What the run is for.
    pub note: Option<String>,
    /// Names that find the run. A run with a tag is kept as if it were pinned.
    pub tags: Vec<String>,
}

impl Marks {
    /// The marks of a run; none where it has no file of them.
    ///
    /// # Errors
    /// The file is damaged or cannot be read. Then the run may be pinned.
    pub fn read(run_dir: &Path) -> anyhow::Result<Self> {
        let path = run_dir.join(FILE);
        let text = match fs::read(&path) {
            Ok(text) => text,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Self::default()),
            Err(error) => return Err(error).with_context(|| format!("cannot read {}", path.display())),
        };
        match serde_json::from_slice(&text) {
            Ok(marks) if sealed::check(&text) == Seal::Whole => Ok(marks),
            _ => bail!("{} is damaged", path.display()),
        }
    }

    /// Writes the marks of a run, so that they survive a power cut.
    ///
    /// # Errors
    /// The system refused an operation.
    pub fn write(&self, run_dir: &Path) -> anyhow::Result<()> {
        let text = sealed::seal(self).context("cannot write marks")?;
        Ok(store::replace_file(&run_dir.join(FILE), &text, true)?)
    }

    /// Whether `gc` never removes the run.
    pub fn keep(&self) -> bool {
        self.pinned || !self.tags.is_empty()
    }
}

/// Why a word cannot be a tag; `None` if it can.
pub fn why_no_tag(word: &str) -> Option<&'static str> {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
    match word {
        "latest" => Some("`latest` names the newest run"),
        _ if runs::is_id(word) || word.starts_with(|c: char| c.is_ascii_digit()) => {
            Some("it looks like the id of a run")
        }
        _ if !word.starts_with(|c: char| c.is_ascii_alphabetic()) => Some("a tag begins with a letter"),
        _ if !word.chars().all(is_plain) => Some("a tag has only letters, digits, `-`, `_` and `.`"),
        _ => None,
    }
}
