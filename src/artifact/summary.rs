//! Statistics of the evaluations of several models.

use serde::{Deserialize, Serialize};

use super::{Artifact, Files, json, tensors::read_json};
use crate::{control::Controller, env::Start, num::stats::Summary};

/// One metric over models: statistics, and the value of each model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MetricSummary {
    /// The statistics.
    #[serde(flatten)]
    pub summary: Summary,
    /// Each model's mean over its episodes, in the order of the inputs.
    pub models: Vec<f64>,
}

/// The results of several models under one evaluation protocol.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ResultSummary {
    /// The controller.
    pub controller: Controller,
    /// Radius of the goal, in units of the state.
    pub radius: f64,
    /// Where episodes started.
    pub start: Start,
    /// T, the number of steps of an episode.
    pub horizon: usize,
    /// The number of episodes of each model.
    pub episodes: Vec<usize>,
    /// Share of T+1 states at the goal, in per cent, as deployed.
    pub percent_goal: MetricSummary,
    /// The same by the policy alone.
    pub policy_alone: MetricSummary,
    /// The same as deployed, over T states instead of T+1.
    pub percent_goal_t: MetricSummary,
    /// Mean %-goal of the best possible controller, where it was measured under this protocol.
    pub ceiling: Option<f64>,
    /// The mean of `percent_goal` in per cent of `ceiling`.
    pub share_of_ceiling: Option<f64>,
}

impl Artifact for ResultSummary {
    const TYPE: &'static str = "summary";
    const MAY_BE_MISSING: &'static [&'static str] = &["standard_error", "ci95", "ceiling", "share_of_ceiling"];

    fn save(self) -> anyhow::Result<Files> {
        Ok(Files::from([("summary.json".to_owned(), json(&self)?)]))
    }

    fn load(files: &Files) -> anyhow::Result<Self> {
        read_json(files, "summary.json")
    }
}
