//! Transitions of a collection, and the saved state of its unfinished episode.
//!
//! Each is a file of its own. [`Transitions`] reads the first file alone. So only the next collection, which asks for
//! [`Collected`], gets the true states of the second.

use super::{Artifact, Files, Transitions, json, tensors::file};
use crate::control::rollout::Standing;

/// The output of a collection.
#[derive(Debug, Clone, PartialEq)]
pub struct Collected {
    /// The transitions, for training.
    pub transitions: Transitions,
    /// The unfinished episode that the next collection continues, if there is one.
    pub standing: Option<Standing>,
}

const FILE: &str = "standing.json";

impl Artifact for Collected {
    const TYPE: &'static str = "collection";
    const READABLE_AS: &'static [&'static str] = &[Transitions::TYPE];

    fn save(&self) -> anyhow::Result<Files> {
        let mut files = self.transitions.save()?;
        if let Some(standing) = &self.standing {
            files.insert(FILE.to_owned(), json(standing)?);
        }
        Ok(files)
    }

    fn load(files: &Files) -> anyhow::Result<Self> {
        let standing = files.get(FILE).map(|_| file(files, FILE)).transpose()?;
        let standing = standing.map(|bytes| serde_json::from_slice(&bytes)).transpose()?;
        Ok(Self { transitions: Transitions::load(files)?, standing })
    }
}
