//! Transitions of a collection, and the saved state of its unfinished episode.
//!
//! Each is a file of its own. [`Transitions`] reads the first file alone. So only the next collection, which asks for
//! [`Collected`], gets the true states of the second.

use super::{Artifact, Files, Transitions, json, tensors::read_json};
use crate::control::episodes::UnfinishedEpisode;

/// The output of a collection.
#[derive(Debug, Clone, PartialEq)]
pub struct Collected {
    /// The transitions, for training.
    pub transitions: Transitions,
    /// The unfinished episode that the next collection continues, if there is one.
    pub unfinished: Option<UnfinishedEpisode>,
}

/// The name from when an unfinished episode was called so. It is part of what digests cover.
const FILE: &str = "standing.json";

impl Artifact for Collected {
    const TYPE: &'static str = "collection";
    const READABLE_AS: &'static [&'static str] = &[Transitions::TYPE];

    fn save(self) -> anyhow::Result<Files> {
        let mut files = self.transitions.save()?;
        if let Some(unfinished) = &self.unfinished {
            files.insert(FILE.to_owned(), json(unfinished)?);
        }
        Ok(files)
    }

    fn load(files: &Files) -> anyhow::Result<Self> {
        let unfinished = files.get(FILE).map(|_| read_json(files, FILE)).transpose()?;
        Ok(Self { transitions: Transitions::load(files)?, unfinished })
    }
}
