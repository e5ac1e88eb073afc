//! The result of an evaluation.

use serde::{Deserialize, Serialize};

use super::{Artifact, Files, json, tensors::read_json};
use crate::{
    control::{Controller, episodes::Unstick},
    env::Start,
};

/// One episode.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EpisodeResult {
    /// The index of the goal.
    pub goal: usize,
    /// Share of the T+1 states at the goal, in per cent, as deployed (with the rule in [`Evaluation::unstick`]).
    pub percent_goal: f64,
    /// The same by the policy alone, without that rule.
    pub policy_alone: f64,
    /// True states visited as deployed, start included.
    pub path: Vec<Vec<f64>>,
}

/// The result of one controller on a set of episodes. The T+1 states after each action count, as in the CARL rows of
/// the paper's Table 1.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Evaluation {
    /// The controller; the file leaves out the default, an agent.
    #[serde(default, skip_serializing_if = "is_agent")]
    pub controller: Controller,
    /// Where episodes started; the file leaves out the default, the usual starts.
    #[serde(default, skip_serializing_if = "is_usual")]
    pub start: Start,
    /// Mean share of T+1 states at the goal, in per cent, as deployed.
    pub percent_goal: f64,
    /// The same by the policy alone.
    pub policy_alone: f64,
    /// The same as deployed, over T states instead of T+1.
    pub percent_goal_t: f64,
    /// `percent_goal` in per cent of the ceiling, the best possible controller's, where the ceiling is known.
    pub share_of_ceiling: Option<f64>,
    /// The rule added to the policy when deployed: what it does whenever the last action left the image unchanged.
    pub unstick: Unstick,
    /// Radius of the goal, in units of the state.
    pub radius: f64,
    /// T, the number of steps of an episode.
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
    const MAY_BE_MISSING: &'static [&'static str] = &["share_of_ceiling"];

    fn save(self) -> anyhow::Result<Files> {
        Ok(Files::from([("evaluation.json".to_owned(), json(&self)?)]))
    }

    fn load(files: &Files) -> anyhow::Result<Self> {
        read_json(files, "evaluation.json")
    }
}
