//! The constants of soft actor-critic.

use super::reward::Reward;

/// Tuples of a batch (paper, Table "Hyper parameters for the SAC controller").
pub const BATCH: usize = 128;

/// How the temperature alpha moves.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Temperature {
    /// Gradient steps move the policy's entropy towards minus the number of action components.
    Tuned(Tuning),
    /// It keeps its first value.
    Fixed,
    /// Every step multiplies it by 0.99995.
    Decayed,
}

/// How the temperature is tuned.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Tuning {
    /// Adam step size of ln alpha.
    pub learning_rate: f64,
}

impl Default for Tuning {
    fn default() -> Self {
        Self { learning_rate: 1e-3 }
    }
}

/// The actions that the critics are trained on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum CriticActions {
    /// Uniformly random actions; the learned dynamics say where they lead.
    Uniform,
    /// The actions of the data.
    Data,
}

/// Constants of the algorithm.
#[derive(Debug, Clone, PartialEq)]
pub struct Sac {
    /// The discount factor, gamma.
    pub discount: f64,
    /// Steps of the latent rollout behind a critic's target, k.
    pub rollout: usize,
    /// Whether a target ends with the target critics' value.
    pub bootstrap: bool,
    /// Share of the new critics in the target critics at every step (the paper's soft target update rate).
    pub tau: f64,
    /// Share of the new actor in the averaged policy at every step.
    pub policy_ema_rate: f64,
    /// Adam step size of the actor.
    pub actor_learning_rate: f64,
    /// Adam step size of the critics.
    pub critic_learning_rate: f64,
    /// How alpha moves.
    pub temperature: Temperature,
    /// The reward of a step.
    pub reward: Reward,
    /// Factor on the speeds of a code in the reward's distance. The distance is rescaled to the same mean square.
    pub speed_weight: f64,
    /// The largest antifriction of latent rollouts. Each rollout draws a factor c from 0 to this number for every speed
    /// v, and each of its steps adds c v to the speed. 0 for none.
    pub antifriction: f64,
    /// Share of the goals that are codes of the data; the other goals are codes of goal images.
    pub relabel: f64,
    /// The actions that the critics are trained on.
    pub critic_actions: CriticActions,
    /// Capacity of the latent replay buffer, in tuples.
    pub buffer: usize,
}
