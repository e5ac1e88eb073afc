//! The settings of iLQR, as an artifact.

use super::{Artifact, Files, json, tensors::file};
use crate::control::Ilqr;

impl Artifact for Ilqr {
    const TYPE: &'static str = "ilqr";

    fn save(&self) -> anyhow::Result<Files> {
        Ok(Files::from([("ilqr.json".to_owned(), json(self)?)]))
    }

    fn load(files: &Files) -> anyhow::Result<Self> {
        Ok(serde_json::from_slice(&file(files, "ilqr.json")?)?)
    }
}
