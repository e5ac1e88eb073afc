//! L_reg(E, E_-, pi, x) = KL((pi∘E)(·|x) || mu(·|x)) with mu = pi∘E_-: keeps a new encoder close to the old one (paper,
//! equation "PI-observation").

use std::sync::{Mutex, PoisonError};

use super::agent::{Agent, log_sigma_is_free};
use crate::{nn::mlp::Pass, num::Real as _};

/// The frozen policy and what it did under the old encoder.
#[derive(Debug)]
pub struct PolicyRegularizer<'a> {
    agent: &'a Agent,
    /// Whitened goal code of every transition; the goals stay where the old encoder put them.
    goals: Vec<f32>,
    /// mu's Gaussian at every transition's x.
    old: Vec<f32>,
    /// Buffers that no thread uses right now; there are as many as threads have asked at once.
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
        Self { input: room(), d_input: room(), pass: Pass::new(&agent.nets.actor.1, 1, 1) }
    }
}

impl<'a> PolicyRegularizer<'a> {
    /// From the old encoder's codes of x and of the goal of every transition, one column each.
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

    /// L_reg of a transition at the code z; adds `weight` times its gradient to `d_z`.
    pub fn at(&self, transition: usize, z: &[f32], weight: f32, d_z: &mut [f32]) -> f32 {
        let taken = self.idle().pop();
        let mut buffers = taken.unwrap_or_else(|| Buffers::new(self.agent));
        let value = self.with(&mut buffers, transition, z, weight, d_z);
        self.idle().push(buffers);
        value
    }

    fn with(&self, buffers: &mut Buffers, transition: usize, z: &[f32], weight: f32, d_z: &mut [f32]) -> f32 {
        let (n, a) = (self.agent.latent, self.agent.action);
        let net = &self.agent.nets.actor.1;
        let Buffers { input, d_input, pass } = buffers;
        self.agent.whitening.apply(z, &mut input[..n]);
        input[n..].copy_from_slice(&self.goals[transition * n..][..n]);
        let mut pass = pass.view(1);
        net.forward(&self.agent.acting, input, &mut pass);
        let old = &self.old[transition * 2 * a..][..2 * a];
        let mut value = 0.0;
        for k in 0..a {
            let free = log_sigma_is_free(pass.out[2][a + k]);
            super::agent::clamp_log_sigma(&mut pass.out[2][a + k..=a + k]);
            let (mu, log_sigma) = (pass.out[2][k], pass.out[2][a + k]);
            let inverse = (-2.0 * old[a + k]).e_to();
            let difference = mu - old[k];
            let ratio = (2.0 * (log_sigma - old[a + k])).e_to();
            value += old[a + k] - log_sigma + 0.5 * (ratio + difference * difference * inverse) - 0.5;
            pass.delta[2][k] = weight * difference * inverse;
            pass.delta[2][a + k] = if free { weight * (ratio - 1.0) } else { 0.0 };
        }
        net.backward(&self.agent.acting, &mut pass, Some(d_input));
        for k in 0..n {
            d_z[k] += d_input[k] * self.agent.whitening.inverse[k];
        }
        value
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng as _;

    use super::*;
    use crate::control::agent::Whitening;

    #[test]
    fn gradient_equals_finite_differences_and_vanishes_at_the_old_code() {
        let mut rng = crate::num::rng::Rng::seed_from_u64(5);
        let whitening = Whitening { mean: vec![0.1, -0.2], inverse: vec![0.8, 1.3] };
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
