//! New tuples for the latent replay buffer.

use super::{
    learner::Learner,
    settings::CriticActions,
    trainer::{SacTrainer, Scratch},
};
use crate::{
    nn::heads,
    num::{sampling, simd::vectorize},
};

impl SacTrainer<'_> {
    /// Adds a batch of tuples to the replay buffer: z ~ E(·|x), a, z' ~ F(·|z, a) and z_g.
    pub(super) fn add_tuples(&mut self) {
        vectorize(
            #[inline(always)]
            || {
                self.draw_codes_and_actions();
                self.model.predict(&self.scratch.z_u.data, &mut self.scratch.dynamics, &mut self.scratch.predicted);
                self.push_predictions();
            },
        );
    }

    /// Draws z ~ E(·|x) and an action for every new tuple.
    #[inline(always)]
    fn draw_codes_and_actions(&mut self) {
        let Learner { agent, rng, .. } = &mut self.learner;
        let (n, a) = (agent.latent, agent.action);
        let Scratch { z_u, epsilon, .. } = &mut self.scratch;
        let count = self.codes.data.len() / (2 * n);
        for z_u in z_u.data.chunks_exact_mut(n + a) {
            let which = sampling::index(rng, count);
            sampling::fill_normal(rng, epsilon);
            let (z, u) = z_u.split_at_mut(n);
            heads::sample(&self.codes.data[which * 2 * n..][..2 * n], epsilon, z);
            match self.settings.critic_actions {
                CriticActions::Uniform => u.fill_with(|| sampling::uniform(rng, -1.0, 1.0)),
                CriticActions::Data => u.copy_from_slice(&self.codes.actions[which * a..][..a]),
            }
        }
    }

    /// Draws z' ~ F(·|z, a) and a goal for every new tuple, and stores the tuples.
    #[inline(always)]
    fn push_predictions(&mut self) {
        let Learner { agent, buffer, rng, .. } = &mut self.learner;
        let (n, a) = (agent.latent, agent.action);
        let Scratch { z_u, predicted, epsilon, tuple, .. } = &mut self.scratch;
        let (count, goals) = (self.codes.data.len() / (2 * n), self.codes.goals.len() / n);
        for (z_u, predicted) in z_u.data.chunks_exact(n + a).zip(predicted.chunks_exact(2 * n)) {
            sampling::fill_normal(rng, epsilon);
            tuple[..n + a].copy_from_slice(z_u);
            let next = &mut tuple[n + a..2 * n + a];
            heads::sample(predicted, epsilon, next);
            for (k, z) in next.iter_mut().enumerate() {
                *z = self.bounds.clamp(k, *z);
            }
            let goal = if f64::from(sampling::uniform(rng, 0.0, 1.0)) < self.settings.relabel {
                &self.codes.data[sampling::index(rng, count) * 2 * n..][..n]
            } else {
                &self.codes.goals[sampling::index(rng, goals) * n..][..n]
            };
            tuple[2 * n + a..].copy_from_slice(goal);
            buffer.push(tuple);
        }
    }
}
