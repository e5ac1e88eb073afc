//! What an evaluation measured.

use serde::{Deserialize, Serialize};

use super::{Artifact, Files, json, tensors::file};
use crate::{
    control::rollout::{Controller, Unstick},
    env::Start,
};

/// One episode.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EpisodeResult {
    /// Which goal.
    pub goal: usize,
    /// Share of the T+1 states at the goal, in per cent, as deployed.
    pub percent_goal: f64,
    /// The same without the rule outside of the policy.
    pub policy_alone: f64,
    /// True states visited, start included, as deployed.
    pub path: Vec<Vec<f64>>,
}

/// Results of one controller on a set of episodes; states count after each of T+1 actions, as in the CARL rows of Table 1.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Evaluation {
    /// Who acted; left out where it was an agent.
    #[serde(default, skip_serializing_if = "is_agent")]
    pub controller: Controller,
    /// Where episodes started; left out where it was as usual.
    #[serde(default, skip_serializing_if = "is_usual")]
    pub start: Start,
    /// Mean share of T+1 states at the goal, in per cent, as deployed.
    pub percent_goal: f64,
    /// The same by the policy alone, without any rule outside of it.
    pub policy_alone: f64,
    /// As deployed, counting T states.
    pub percent_goal_t: f64,
    /// `percent_goal` as a share of the best possible controller's, in per cent, where that is known.
    pub share_of_ceiling: Option<f64>,
    /// The rule outside of the policy; it sees one bit, whether the picture changed.
    pub unstick: Unstick,
    /// Radius of the goal.
    pub radius: f64,
    /// T.
    pub horizon: usize,
    /// Every episode.
    pub episodes: Vec<EpisodeResult>,
}

fn is_usual(start: &Start) -> bool {
    *start == Start::Usual
}

fn is_agent(controller: &Controller) -> bool {
    *controller == Controller::Agent
}

impl Artifact for Evaluation {
    const TYPE: &'static str = "evaluation";

    fn save(&self) -> anyhow::Result<Files> {
        Ok(Files::from([("evaluation.json".to_owned(), json(self)?)]))
    }

    fn load(files: &Files) -> anyhow::Result<Self> {
        Ok(serde_json::from_slice(file(files, "evaluation.json")?)?)
    }
}
