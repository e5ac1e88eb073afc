//! The contract of a policy: what evaluation and collection run, whatever controls.

use crate::num::rng::Rng;

/// A controller in closed loop. One value may run many episodes, one after the other.
pub trait Policy {
    /// Begins an episode. `plans` is a random stream for plans, which the loop does not touch.
    fn begin(&mut self, goal: Goal<'_>, plans: Rng);

    /// The next action; each component is a share of its limit, in -1..1. `rng` is the stream of the episode, from which
    /// the simulator draws too.
    fn act(&mut self, moment: &Moment<'_>, rng: &mut Rng) -> Vec<f32>;
}

/// The goal of an episode.
#[derive(Debug, Clone, Copy)]
pub struct Goal<'a> {
    /// Which of the task's goals.
    pub index: usize,
    /// The observation at rest at the goal.
    pub image: &'a [u8],
}

/// What a policy sees before it acts.
#[derive(Debug)]
pub struct Moment<'a> {
    /// Steps done since the policy began.
    pub step: usize,
    /// Steps that remain, the next one included.
    pub left: usize,
    /// The observation now.
    pub observation: &'a [u8],
    /// The action that was applied last, which a rule of the loop may have replaced; `None` at the first step.
    pub last_action: Option<&'a [f32]>,
    /// The true state, where the simulator tells it. Only the oracle reads it.
    pub(super) true_state: Option<&'a [f64]>,
}

/// The controllers that an evaluation can name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Controller {
    /// The learned agent, which acts on images.
    #[default]
    Agent,
    /// iLQR, which plans in the learned model and acts on images.
    Ilqr,
    /// SOLAR's time-varying linear policies, which act on the filtered latent state.
    Solar,
    /// The task's own controller, which reads the true state: how far the best representation could lead.
    Oracle,
}
