//! The critics' update.

use super::{
    replay::Tuple,
    settings::BATCH,
    trainer::{SacTrainer, Scratch},
};
use crate::{
    control::agent::{Network, Trained},
    nn::{adam::AdamSettings, mat::Accumulate, mlp::Pass},
    num::join,
};

impl SacTrainer<'_> {
    /// One step on J_Q for both critics (paper, "Soft Actor Critic (SAC) Updates", second equation). Returns the mean
    /// of both losses.
    pub(super) fn update_critics(&mut self, threads: usize, learning_rate_scale: f64) -> f64 {
        self.fill_critic_inputs();
        let learning_rate = self.settings.critic_learning_rate * learning_rate_scale;
        let settings = AdamSettings { learning_rate, weight_decay: 0.0 };
        let net = &self.learner.agent.nets.critic;
        let Scratch { critic_inputs, rollout, critics, critic_gradients, .. } = &mut self.scratch;
        let (inputs, targets) = (&critic_inputs.data, &rollout.target.data);
        let [critic_0, critic_1] = &mut self.learner.agent.critics;
        let [pass_0, pass_1] = critics;
        let [gradient_0, gradient_1] = critic_gradients;
        let ((loss_0, is_finite_0), (loss_1, is_finite_1)) = join(
            threads,
            || regress(net, critic_0, settings, (inputs, targets), pass_0, gradient_0),
            || regress(net, critic_1, settings, (inputs, targets), pass_1, gradient_1),
        );
        self.is_finite &= is_finite_0 && is_finite_1;
        0.5 * (loss_0 + loss_1)
    }

    /// Whitened (z, z_g) and (z, z_g, a) of the batch, which critics and actor read.
    fn fill_critic_inputs(&mut self) {
        let (n, a) = (self.learner.agent.latent, self.learner.agent.action);
        let Scratch { tuples, state_inputs, critic_inputs, .. } = &mut self.scratch;
        let inputs = state_inputs.data.chunks_exact_mut(2 * n).zip(critic_inputs.data.chunks_exact_mut(2 * n + a));
        for (tuple, (input, critic_input)) in tuples.data.chunks_exact(self.learner.buffer.width).zip(inputs) {
            let Tuple { z, action, z_goal, .. } = Tuple::read(tuple, n, a);
            self.learner.agent.input(z, z_goal, input);
            critic_input[..2 * n].copy_from_slice(input);
            critic_input[2 * n..].copy_from_slice(action);
        }
    }
}

/// One Adam step on J_Q = E[(Q(z, a) - target)² / 2]. Returns J_Q, and whether the critic is finite after the step.
fn regress(
    net: &Network,
    critic: &mut Trained,
    settings: AdamSettings,
    (inputs, targets): (&[f32], &[f32]),
    pass: &mut Pass<f32, 3>,
    gradient: &mut [f32],
) -> (f64, bool) {
    let mut pass = pass.view(BATCH);
    net.mlp.forward(&critic.arena, inputs, &mut pass);
    let mut loss = 0.0;
    let (values, deltas) = pass.output_and_delta();
    for ((value, target), delta) in values.iter().zip(targets).zip(deltas) {
        let error = value - target;
        loss += 0.5 * f64::from(error * error);
        *delta = error / BATCH as f32;
    }
    net.mlp.backward(&critic.arena, &mut pass, None);
    net.mlp.gradient(1, gradient, Accumulate::Replace, inputs, &pass);
    let is_finite = critic.adam.step(1, settings, &mut critic.arena, gradient);
    (loss / BATCH as f64, is_finite)
}
