//! Transitions of a collection, and where its last episode stands.
//!
//! The two lie in files of their own. [`Transitions`] reads the first alone, so the true states of the second reach
//! nobody but who asks for [`Collected`]: the next collection.

use super::{Artifact, Files, Transitions, json, tensors::file};
use crate::control::rollout::Standing;

/// What was collected.
#[derive(Debug, Clone, PartialEq)]
pub struct Collected {
    /// All that training sees.
    pub transitions: Transitions,
    /// Where the last episode was left, if it is to go on.
    pub standing: Option<Standing>,
}

const FILE: &str = "standing.json";

impl Artifact for Collected {
    const TYPE: &'static str = Transitions::TYPE;

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
