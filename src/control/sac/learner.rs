//! The state of a training with soft actor-critic.

use super::replay::{LatentBuffer, Tuple};
use crate::{control::agent::Agent, num::rng::Rng};

/// Everything that training changes. Training continues from a saved learner with the same bits.
#[derive(Debug, PartialEq)]
pub struct Learner {
    /// The agent, with its optimisers and averages.
    pub agent: Agent,
    /// The latent replay buffer.
    pub buffer: LatentBuffer,
    /// The random stream of the updates.
    pub rng: Rng,
    /// Updates so far.
    pub steps: u64,
}

impl Learner {
    /// `agent` before its first update, with an empty buffer for `capacity` tuples.
    pub fn new(agent: Agent, capacity: usize, rng: Rng) -> Self {
        let buffer = LatentBuffer::new(Tuple::width(agent.latent, agent.action), capacity);
        Self { agent, buffer, rng, steps: 0 }
    }
}
