//! The regularizer L_reg(E, E_-, pi, x) = KL((pi∘E)(·|x) || mu(·|x)) with mu = pi∘E_-, which keeps a new encoder close
//! to the old one (paper, equation "PI-observation").

use std::sync::{Mutex, PoisonError};

use super::{
    actor_kl::{VarianceRatio, actor_kl},
    agent::Agent,
};
use crate::nn::mlp::Pass;

/// A frozen policy, and its Gaussians under the old encoder.
#[derive(Debug)]
pub struct PolicyRegularizer<'a> {
    agent: &'a Agent,
    /// The whitened goal code of every transition, under the old encoder.
    goals: Vec<f32>,
    /// mu's Gaussian at every transition's x.
    old: Vec<f32>,
    /// Buffers that no thread uses at the moment. Every thread takes one and returns it.
    idle: Mutex<Vec<Buffers>>,
}

/// Buffers for one transition.
#[derive(Debug)]
struct Buffers {
    input: Vec<f32>,
    d_input: Vec<f32>,
    pass: Pass<f32, 3>,
}

impl Buffers {
    fn new(agent: &Agent) -> Self {
        let room = || vec![0.0; 2 * agent.latent];
        Self { input: room(), d_input: room(), pass: Pass::new(&agent.nets.actor.mlp, 1, 1) }
    }
}

impl<'a> PolicyRegularizer<'a> {
    /// The regularizer for transitions whose x and goal have these codes under the old encoder, one column each.
    pub fn new(agent: &'a Agent, old_codes: &[f32], goal_codes: &[f32]) -> Self {
        let n = agent.latent;
        let mut inputs = vec![0.0; 2 * old_codes.len()];
        let pairs = old_codes.chunks_exact(n).zip(goal_codes.chunks_exact(n));
        for (input, (z, goal)) in inputs.chunks_exact_mut(2 * n).zip(pairs) {
            agent.input(z, goal, input);
        }
        let goals = inputs.chunks_exact(2 * n).flat_map(|input| &input[n..]).copied().collect();
        Self { agent, goals, old: agent.gaussians(&agent.acting, &inputs), idle: Mutex::default() }
    }

    fn idle(&self) -> std::sync::MutexGuard<'_, Vec<Buffers>> {
        self.idle.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// L_reg of a transition at the code z. Adds `weight` times its gradient to `d_z`.
    pub fn at(&self, transition: usize, z: &[f32], weight: f32, d_z: &mut [f32]) -> f32 {
        let taken = self.idle().pop();
        let mut buffers = taken.unwrap_or_else(|| Buffers::new(self.agent));
        let value = self.at_with(&mut buffers, transition, z, weight, d_z);
        self.idle().push(buffers);
        value
    }

    fn at_with(&self, buffers: &mut Buffers, transition: usize, z: &[f32], weight: f32, d_z: &mut [f32]) -> f32 {
        let (agent, n, width) = (self.agent, self.agent.latent, 2 * self.agent.action);
        let net = &agent.nets.actor.mlp;
        let Buffers { input, d_input, pass } = buffers;
        let (code, goal) = input.split_at_mut(n);
        agent.whiten(z, code);
        goal.copy_from_slice(&self.goals[transition * n..][..n]);
        let mut pass = pass.view(1);
        net.forward(&agent.acting, input, &mut pass);
        let old = &self.old[transition * width..][..width];
        let mut value = 0.0;
        let (gaussian, delta) = pass.output_and_delta();
        actor_kl(gaussian, old, VarianceRatio::Difference, weight, delta, |kl| value += kl);
        net.backward(&agent.acting, &mut pass, Some(d_input));
        agent.whiten_backward(&d_input[..n], d_z);
        value
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng as _;

    use super::*;
    use crate::control::agent::Whitening;

    #[test]
    fn the_gradient_equals_finite_differences_and_vanishes_at_the_old_code() {
        let mut rng = crate::num::rng::Rng::seed_from_u64(5);
        let whitening = Some(Whitening { mean: vec![0.1, -0.2], inverse: vec![0.8, 1.3] });
        let agent = Agent::new(2, 2, whitening, 0.0, &mut rng);
        let regularizer = PolicyRegularizer::new(&agent, &[0.3, -0.4], &[1.0, 0.5]);
        let mut at_old = [0.0; 2];
        assert!(
            regularizer.at(0, &[0.3, -0.4], 1.0, &mut at_old).abs() < 1e-6 && at_old.iter().all(|g| g.abs() < 1e-5)
        );
        let (z, mut gradient) = ([1.5, 0.9], [0.0; 2]);
        regularizer.at(0, &z, 1.0, &mut gradient);
        for k in 0..2 {
            let value = |h: f32| {
                let mut moved = z;
                moved[k] += h;
                f64::from(regularizer.at(0, &moved, 0.0, &mut [0.0; 2]))
            };
            let slope = (value(2e-2) - value(-2e-2)) / 4e-2;
            assert!((slope - f64::from(gradient[k])).abs() < 0.03 * slope.abs() + 1e-4, "{slope} {}", gradient[k]);
        }
    }
}
