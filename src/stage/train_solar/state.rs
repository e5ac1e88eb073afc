//! Where the training of a SOLAR model stands between two passes.

use serde::{Deserialize, Serialize};

use crate::{
    artifact::{Files, json, tensors::read_json},
    solar::SolarModel,
    stage::{
        StageState,
        state::{put_artifact, take_artifact},
    },
};

/// A training. Every pass draws from streams of its own.
pub(super) struct Training {
    pub(super) model: SolarModel,
    /// Passes done.
    pub(super) epoch: u64,
    /// Batches done.
    pub(super) step: u64,
}

#[derive(Serialize, Deserialize)]
struct About {
    epoch: u64,
    step: u64,
}

impl StageState for Training {
    fn save(&self) -> anyhow::Result<Files> {
        let about = About { epoch: self.epoch, step: self.step };
        let mut files = Files::from([("training.json".to_owned(), json(&about)?)]);
        put_artifact(&mut files, "model", self.model.clone())?;
        Ok(files)
    }

    fn load(files: &Files) -> anyhow::Result<Self> {
        let About { epoch, step } = read_json(files, "training.json")?;
        Ok(Self { model: take_artifact(files, "model")?, epoch, step })
    }
}
