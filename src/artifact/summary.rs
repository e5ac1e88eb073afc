//! Evaluations of several models, summed up.

use serde::{Deserialize, Serialize};

use super::{Artifact, Files, json, tensors::file};
use crate::{control::rollout::Controller, env::Start, num::stats::Summary};

/// One metric over models, with the value of each.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MetricSummary {
    /// Its statistics.
    #[serde(flatten)]
    pub summary: Summary,
    /// Each model's mean over its episodes, in the order of the inputs.
    pub models: Vec<f64>,
}

/// What several models reach on their episodes, under one protocol.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ResultSummary {
    /// Who acted.
    pub controller: Controller,
    /// Radius of the goal.
    pub radius: f64,
    /// Where episodes started.
    pub start: Start,
    /// T.
    pub horizon: usize,
    /// Episodes of each model.
    pub episodes: Vec<usize>,
    /// Share of T+1 states at the goal, in per cent, as deployed.
    pub percent_goal: MetricSummary,
    /// The same by the policy alone.
    pub policy_alone: MetricSummary,
    /// As deployed, counting T states.
    pub percent_goal_t: MetricSummary,
    /// Mean %-goal of the best possible controller, where it is known for this protocol.
    pub ceiling: Option<f64>,
    /// The mean of `percent_goal` as a share of `ceiling`, in per cent.
    pub share_of_ceiling: Option<f64>,
}

impl Artifact for ResultSummary {
    const TYPE: &'static str = "summary";

    fn save(&self) -> anyhow::Result<Files> {
        Ok(Files::from([("summary.json".to_owned(), json(self)?)]))
    }

    fn load(files: &Files) -> anyhow::Result<Self> {
        Ok(serde_json::from_slice(file(files, "summary.json")?)?)
    }
}
