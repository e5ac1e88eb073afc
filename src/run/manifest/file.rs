//! Reads and writes manifests.

use std::{
    fs, io,
    path::{Path, PathBuf},
};

use anyhow::Context as _;
use serde_json::Value;

use super::Manifest;
use crate::{
    failpoint::failpoint,
    pipeline::Member,
    store::{
        self,
        sealed::{self, Seal},
    },
};

/// The format of a manifest. Raise it when an older carl-pipe would misread a manifest.
pub(super) const FORMAT: u32 = 2;

/// The format before manifests had a digest over their own text.
pub(super) const UNSEALED: u32 = 1;

/// Why the manifest of a run cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum Unreadable {
    /// There is none.
    #[error("{} is missing", .0.display())]
    Missing(PathBuf),
    /// Its text is not what was written.
    #[error("{} is damaged: {why}", path.display())]
    Damaged {
        /// The manifest.
        path: PathBuf,
        /// What is wrong with it.
        why: String,
    },
    /// Another carl-pipe wrote it.
    #[error("{} is of format {found}, but this carl-pipe reads formats {UNSEALED} and {FORMAT}", path.display())]
    OtherFormat {
        /// The manifest.
        path: PathBuf,
        /// Its format.
        found: u64,
    },
    /// The system refused to read it.
    #[error("cannot read {}", path.display())]
    System {
        /// The manifest.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
}

impl Unreadable {
    /// What is wrong, in a few words.
    pub fn short(&self) -> &'static str {
        match self {
            Self::Missing(_) => "no manifest",
            Self::Damaged { .. } => "damaged manifest",
            Self::OtherFormat { .. } => "manifest of another carl-pipe",
            Self::System { .. } => "unreadable manifest",
        }
    }
}

impl Manifest {
    /// Reads the manifest of a run.
    ///
    /// # Errors
    /// See [`Unreadable`].
    pub fn read(run_dir: &Path) -> Result<Self, Unreadable> {
        let path = run_dir.join("manifest.json");
        let text = match failpoint!("read manifest", fs::read(&path)) {
            Ok(text) => text,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Err(Unreadable::Missing(path)),
            Err(source) => return Err(Unreadable::System { path, source }),
        };
        let damaged = |why: &str| Unreadable::Damaged { path: path.clone(), why: why.to_owned() };
        let seal = sealed::check(&text);
        if seal == Seal::Broken {
            return Err(damaged("its text does not match the digest in its first line"));
        }
        let json: Value = serde_json::from_slice(&text).map_err(|error| damaged(&error.to_string()))?;
        match json["format"].as_u64() {
            Some(found) if found == u64::from(UNSEALED) => {}
            Some(found) if found == u64::from(FORMAT) && seal == Seal::Whole => {}
            Some(found) if found == u64::from(FORMAT) => return Err(damaged("its first line is lost")),
            Some(found) => return Err(Unreadable::OtherFormat { path, found }),
            None => return Err(damaged("it names no format")),
        }
        let mut manifest: Self = serde_json::from_value(json).map_err(|error| damaged(&error.to_string()))?;
        if manifest.members.is_empty() {
            // An older carl-pipe, without suites, wrote it.
            manifest.members.push(Member { pipeline: manifest.pipeline.clone(), ..Member::default() });
        }
        if manifest.nodes.iter().any(|record| record.about.member >= manifest.members.len()) {
            return Err(damaged("it names a pipeline that it does not list"));
        }
        manifest.run_dir = Some(run_dir.to_owned());
        Ok(manifest)
    }

    /// Writes the manifest whole; `durable` also makes it safe from a power cut.
    pub(crate) fn write(&self, run_dir: &Path, durable: bool) -> anyhow::Result<()> {
        let text = sealed::seal(self).context("cannot write a manifest")?;
        Ok(store::replace_file(&run_dir.join("manifest.json"), &text, durable)?)
    }
}
