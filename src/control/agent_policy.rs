//! The learned agent as a policy: it acts on E(x) and E(x_g).

use super::{
    agent::Agent,
    policy::{Goal, Moment, Policy},
};
use crate::{
    lce::{LceModel, PreparedEncoder},
    num::{rng::Rng, sampling},
};

/// How an agent's actions are chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Acting {
    /// The mean action.
    Mean,
    /// A sample of the agent's distribution.
    Sample,
}

/// An agent that reads the latent space of a model.
#[derive(Debug)]
pub struct AgentPolicy<'a> {
    encoder: PreparedEncoder<'a>,
    agent: &'a Agent,
    acting: Acting,
    z_goal: Vec<f32>,
}

impl<'a> AgentPolicy<'a> {
    /// An agent and the model whose encoder it reads.
    pub fn new(model: &'a LceModel, agent: &'a Agent, acting: Acting) -> Self {
        Self { encoder: PreparedEncoder::new(model, 1), agent, acting, z_goal: Vec::new() }
    }
}

impl Policy for AgentPolicy<'_> {
    fn begin(&mut self, goal: Goal<'_>, _: Rng) {
        self.z_goal = self.encoder.mean(goal.image);
    }

    /// Draws the noise of a sample also where the mean acts, so that both draw the same from the stream.
    fn act(&mut self, moment: &Moment<'_>, rng: &mut Rng) -> Vec<f32> {
        let z = self.encoder.mean(moment.observation);
        let mut epsilon = vec![0.0; self.agent.action];
        sampling::fill_normal(rng, &mut epsilon);
        let noise = (self.acting == Acting::Sample).then_some(&epsilon[..]);
        self.agent.act(&z, &self.z_goal, noise)
    }
}
