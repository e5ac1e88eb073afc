//! The actor's update.

use super::{
    settings::BATCH,
    trainer::{SacTrainer, Scratch},
};
use crate::{
    control::agent::{Trained, clamp_log_sigma, log_sigma_is_free, squash},
    nn::{adam::AdamSettings, mat::Accumulate},
    num::{Real as _, join, simd::vectorize},
};

impl SacTrainer<'_> {
    /// One step on J_pi = E[alpha ln pi(a|z) - min Q(z, a)] (paper, "Soft Actor Critic (SAC) Updates", first equation).
    /// Returns J_pi and the policy's entropy.
    pub(super) fn update_actor(&mut self, threads: usize, learning_rate_scale: f64) -> (f64, f64) {
        vectorize(
            #[inline(always)]
            || {
                self.sample_actions();
                let loss = self.evaluate_actions(threads);
                self.step_actor(learning_rate_scale);
                let log_pi = self.scratch.log_pi.iter().map(|&l| f64::from(l)).sum::<f64>();
                (loss, -log_pi / BATCH as f64)
            },
        )
    }

    /// Samples a ~ pi(·|z) into the critics' inputs, and keeps ln pi(a|z).
    #[inline(always)]
    fn sample_actions(&mut self) {
        let (n, a) = (self.learner.agent.latent, self.learner.agent.action);
        let Scratch { state_inputs, critic_inputs, actor, actor_noise, log_pi, .. } = &mut self.scratch;
        let mut actor = actor.view(BATCH);
        self.learner.agent.nets.actor.mlp.forward(&self.learner.agent.actor.arena, &state_inputs.data, &mut actor);
        let (gaussians, deltas) = actor.output_and_delta();
        // The gradient needs log standard deviations as they were before the clamp: deltas keep them until then.
        deltas.copy_from_slice(gaussians);
        let columns = gaussians.chunks_exact_mut(2 * a).zip(actor_noise.chunks_exact(a));
        let inputs = critic_inputs.data.chunks_exact_mut(2 * n + a).zip(log_pi);
        for ((gaussian, noise), (input, log_pi)) in columns.zip(inputs) {
            clamp_log_sigma(&mut gaussian[a..]);
            *log_pi = squash(gaussian, noise, &mut input[2 * n..]);
        }
    }

    /// The critics at the sampled actions, and the gradient of the smaller one with respect to its input. Returns
    /// J_pi.
    #[inline(always)]
    fn evaluate_actions(&mut self, threads: usize) -> f64 {
        let (alpha, net) = (self.learner.agent.temperature(), &self.learner.agent.nets.critic.mlp);
        let Scratch { critic_inputs, critics, d_critic_inputs, log_pi, .. } = &mut self.scratch;
        let [critic_0, critic_1] = &self.learner.agent.critics;
        let [pass_0, pass_1] = critics;
        let (mut pass_0, mut pass_1) = (pass_0.view(BATCH), pass_1.view(BATCH));
        let inputs = &critic_inputs.data;
        join(
            threads,
            || net.forward(&critic_0.arena, inputs, &mut pass_0),
            || net.forward(&critic_1.arena, inputs, &mut pass_1),
        );
        let mut loss = 0.0;
        let ((values_0, deltas_0), (values_1, deltas_1)) = (pass_0.output_and_delta(), pass_1.output_and_delta());
        for i in 0..BATCH {
            let (q_0, q_1) = (values_0[i], values_1[i]);
            let slope = -1.0 / BATCH as f32;
            (deltas_0[i], deltas_1[i]) = if q_0 < q_1 { (slope, 0.0) } else { (0.0, slope) };
            loss += f64::from(alpha * log_pi[i] - q_0.min(q_1));
        }
        let [d_input_0, d_input_1] = d_critic_inputs;
        join(
            threads,
            || net.backward(&critic_0.arena, &mut pass_0, Some(&mut d_input_0.data)),
            || net.backward(&critic_1.arena, &mut pass_1, Some(&mut d_input_1.data)),
        );
        loss / BATCH as f64
    }

    /// The gradient through the sampled actions into the actor, and its Adam step.
    #[inline(always)]
    fn step_actor(&mut self, learning_rate_scale: f64) {
        let (n, a) = (self.learner.agent.latent, self.learner.agent.action);
        let (alpha, net) = (self.learner.agent.temperature(), &self.learner.agent.nets.actor.mlp);
        let Scratch { state_inputs, critic_inputs, d_critic_inputs, actor, actor_gradient, actor_noise, .. } =
            &mut self.scratch;
        let mut actor = actor.view(BATCH);
        let (gaussians, deltas) = actor.output_and_delta();
        let [d_input_0, d_input_1] = d_critic_inputs;
        for i in 0..BATCH {
            let at = i * (2 * n + a) + 2 * n;
            for k in 0..a {
                let (mu, sigma) = (i * 2 * a + k, i * 2 * a + a + k);
                let action = critic_inputs.data[at + k];
                let d_action = d_input_0.data[at + k] + d_input_1.data[at + k];
                let d_pre = alpha / BATCH as f32 * 2.0 * action + d_action * (1.0 - action * action);
                let free = log_sigma_is_free(deltas[sigma]);
                let spread = gaussians[sigma].e_to() * actor_noise[i * a + k];
                deltas[mu] = d_pre;
                deltas[sigma] = if free { d_pre * spread - alpha / BATCH as f32 } else { 0.0 };
            }
        }
        net.backward(&self.learner.agent.actor.arena, &mut actor, None);
        net.gradient(1, actor_gradient, Accumulate::Replace, &state_inputs.data, &actor);
        let learning_rate = self.settings.actor_learning_rate * learning_rate_scale;
        let settings = AdamSettings { learning_rate, weight_decay: 0.0 };
        let Trained { arena, adam } = &mut self.learner.agent.actor;
        self.is_finite &= adam.step(1, settings, arena, actor_gradient);
    }
}
