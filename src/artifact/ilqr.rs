//! The settings of iLQR, as an artifact.

use anyhow::ensure;

use super::{Artifact, Files, json, tensors::read_json};
use crate::control::Ilqr;

impl Artifact for Ilqr {
    const TYPE: &'static str = "ilqr";

    fn save(self) -> anyhow::Result<Files> {
        Ok(Files::from([("ilqr.json".to_owned(), json(&self)?)]))
    }

    fn load(files: &Files) -> anyhow::Result<Self> {
        let settings: Self = read_json(files, "ilqr.json")?;
        let plans = settings.uniform_plans.saturating_add(settings.bang_bang_plans);
        ensure!(settings.plan_length > 0 && plans > 0, "{plans} plans of {} steps", settings.plan_length);
        Ok(settings)
    }
}
