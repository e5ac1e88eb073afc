//! Value-guided weights exp(tau/gamma ŵ) of L_p and L_c (paper, "Value-Guided CARL").
//!
//! ŵ(x, a, x') = E[r̄ - Q(z, a) + gamma V(z')] over z ~ E(·|x) and z' ~ E(·|x') is the TD error in the latent space. Q is
//! the smaller critic, and V(z') = E[Q(z', a') - alpha ln pi(a'|z')] over a' ~ pi(·|z'). The encoder is the one that the
//! critics were trained under. No true state enters the weights.

use super::{
    agent::{Agent, clamp_log_sigma, squash},
    sac::Reward,
};
use crate::{
    nn::{columns::Block, heads, mlp::Pass},
    num::{Real as _, rng::Rng, sampling, simd::vectorize},
};

/// How TD errors become weights.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Guidance {
    /// tau. With 0 all transitions have the same weight.
    pub temperature: f64,
    /// The discount factor that the agent was trained with, gamma.
    pub discount: f64,
    /// The reward that the agent was trained for.
    pub reward: Reward,
    /// Samples of codes and actions that a TD error averages over.
    pub samples: u64,
    /// Exponents are clamped to minus and plus this, so that no transition outweighs all others.
    pub bound: f64,
    /// Whether weights are divided by their mean. Then they shift weight between transitions, not between losses.
    pub normalize: bool,
}

impl Default for Guidance {
    fn default() -> Self {
        Self {
            temperature: 1.0 / 30.0,
            discount: 0.99,
            reward: Reward::Distance,
            samples: 8,
            bound: 2.0,
            normalize: true,
        }
    }
}

/// Transitions in the agent's latent space, one column each.
#[derive(Debug, Clone, Copy)]
pub struct LatentTransitions<'a> {
    /// Gaussians E(·|x).
    pub now: &'a [f32],
    /// Gaussians E(·|x').
    pub next: &'a [f32],
    /// Actions in -1..1.
    pub actions: &'a [f32],
    /// The goals' codes z_g.
    pub goals: &'a [f32],
}

/// How unequal weights are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spread {
    /// The effective sample size (Σ w)² / Σ w² over the number of transitions; 1 where all weights are equal.
    pub effective_share: f64,
    /// The smallest weight.
    pub smallest: f64,
    /// The largest weight.
    pub largest: f64,
}

impl Spread {
    /// The spread of some weights.
    pub fn of(weights: &[f32]) -> Self {
        let [mut sum, mut squares, mut smallest, mut largest] = [0.0, 0.0, f64::INFINITY, 0.0_f64];
        for weight in weights.iter().map(|&weight| f64::from(weight)) {
            sum += weight;
            squares += weight * weight;
            (smallest, largest) = (smallest.min(weight), largest.max(weight));
        }
        Self { effective_share: sum * sum / (squares * weights.len() as f64), smallest, largest }
    }
}

/// Transitions that are processed together.
const AT_ONCE: usize = 128;

/// Buffers of [`AT_ONCE`] transitions.
struct Scratch {
    epsilon: Vec<f32>,
    z: Vec<f32>,
    z_next: Block<f32>,
    state_inputs: Block<f32>,
    actor: Pass<f32, 3>,
    critic_inputs: Block<f32>,
    critic: Pass<f32, 3>,
    log_pi: Vec<f32>,
    now: Vec<f32>,
    next: Vec<f32>,
}

impl Scratch {
    fn new(agent: &Agent) -> Self {
        let (n, a) = (agent.latent, agent.action);
        Self {
            epsilon: vec![0.0; 2 * n + a],
            z: vec![0.0; n],
            z_next: Block::new(n, AT_ONCE),
            state_inputs: Block::new(2 * n, AT_ONCE),
            actor: Pass::new(&agent.nets.actor.mlp, AT_ONCE, 1),
            critic_inputs: Block::new(2 * n + a, AT_ONCE),
            critic: Pass::new(&agent.nets.critic.mlp, AT_ONCE, 1),
            log_pi: vec![0.0; AT_ONCE],
            now: vec![0.0; AT_ONCE],
            next: vec![0.0; AT_ONCE],
        }
    }
}

impl Guidance {
    /// The TD error ŵ of every transition.
    pub fn td_errors(&self, agent: &Agent, transitions: &LatentTransitions<'_>, rng: &mut Rng) -> Vec<f32> {
        let (n, a) = (agent.latent, agent.action);
        let mut scratch = Scratch::new(agent);
        let mut errors = vec![0.0; transitions.actions.len() / a];
        for (which, errors) in errors.chunks_mut(AT_ONCE).enumerate() {
            let first = which * AT_ONCE;
            let of = |width: usize| first * width..(first + errors.len()) * width;
            let chunk = LatentTransitions {
                now: &transitions.now[of(2 * n)],
                next: &transitions.next[of(2 * n)],
                actions: &transitions.actions[of(a)],
                goals: &transitions.goals[of(n)],
            };
            for _ in 0..self.samples {
                vectorize(
                    #[inline(always)]
                    || self.add_sample(agent, &chunk, &mut scratch, rng, errors),
                );
            }
        }
        errors
    }

    /// Adds one sample of r̄ - Q(z, a) + gamma (Q(z', a') - alpha ln pi(a'|z')), over the number of samples, to the
    /// TD error of every transition.
    #[inline(always)]
    fn add_sample(
        &self,
        agent: &Agent,
        transitions: &LatentTransitions<'_>,
        s: &mut Scratch,
        rng: &mut Rng,
        errors: &mut [f32],
    ) {
        let count = errors.len();
        let (discount, alpha) = (self.discount as f32, agent.temperature());
        let share = 1.0 / self.samples as f32;
        self.sample_codes(agent, transitions, s, rng, errors);
        smaller_critic(agent, s.critic_inputs.view(count).data, &mut s.critic, &mut s.now[..count]);
        sample_next_actions(agent, s, rng, count);
        smaller_critic(agent, s.critic_inputs.view(count).data, &mut s.critic, &mut s.next[..count]);
        for (i, error) in errors.iter_mut().enumerate() {
            *error += share * (discount * (s.next[i] - alpha * s.log_pi[i]) - s.now[i]);
        }
    }

    /// Samples z and z' into the inputs of critics and actor, and adds the reward's part to the TD errors.
    #[inline(always)]
    fn sample_codes(
        &self,
        agent: &Agent,
        transitions: &LatentTransitions<'_>,
        s: &mut Scratch,
        rng: &mut Rng,
        errors: &mut [f32],
    ) {
        let (n, a, count) = (agent.latent, agent.action, errors.len());
        let share = 1.0 / self.samples as f32;
        let (mut z_next, mut state, mut critic) =
            (s.z_next.view(count), s.state_inputs.view(count), s.critic_inputs.view(count));
        for (i, error) in errors.iter_mut().enumerate() {
            sampling::fill_normal(rng, &mut s.epsilon);
            let (goal, action) = (&transitions.goals[i * n..][..n], &transitions.actions[i * a..][..a]);
            heads::sample(&transitions.now[i * 2 * n..][..2 * n], &s.epsilon[..n], &mut s.z);
            heads::sample(&transitions.next[i * 2 * n..][..2 * n], &s.epsilon[n..2 * n], z_next.sample(i));
            *error += share * self.reward.of(action, z_next.sample(i), goal);
            let (critic_state, critic_action) = critic.sample(i).split_at_mut(2 * n);
            agent.input(&s.z, goal, critic_state);
            critic_action.copy_from_slice(action);
            agent.input(z_next.sample(i), goal, state.sample(i));
        }
    }

    /// The weights exp(tau/gamma ŵ) of transitions with these TD errors.
    pub fn weights(&self, errors: &[f32]) -> Vec<f32> {
        let rate = (self.temperature / self.discount) as f32;
        let mean = |values: &[f32]| values.iter().map(|&v| f64::from(v)).sum::<f64>() / values.len() as f64;
        let middle = if self.normalize { rate * mean(errors) as f32 } else { 0.0 };
        let bound = self.bound as f32;
        let mut weights: Vec<f32> =
            errors.iter().map(|&error| (rate * error - middle).clamp(-bound, bound).e_to()).collect();
        if self.normalize {
            let inverse = (1.0 / mean(&weights)) as f32;
            weights.iter_mut().for_each(|weight| *weight *= inverse);
        }
        weights
    }
}

/// Samples a' ~ pi(·|z') into the critics' inputs, and keeps ln pi(a'|z').
#[inline(always)]
fn sample_next_actions(agent: &Agent, s: &mut Scratch, rng: &mut Rng, count: usize) {
    let (n, a) = (agent.latent, agent.action);
    let (mut actor, mut state, mut critic) =
        (s.actor.view(count), s.state_inputs.view(count), s.critic_inputs.view(count));
    agent.nets.actor.mlp.forward(&agent.acting, state.data, &mut actor);
    let (gaussians, _) = actor.output_and_delta();
    for (i, gaussian) in gaussians.chunks_exact_mut(2 * a).enumerate() {
        sampling::fill_normal(rng, &mut s.epsilon[..a]);
        clamp_log_sigma(&mut gaussian[a..]);
        let (critic_state, critic_action) = critic.sample(i).split_at_mut(2 * n);
        critic_state.copy_from_slice(state.sample(i));
        s.log_pi[i] = squash(gaussian, &s.epsilon[..a], critic_action);
    }
}

/// The smaller critic's values at whitened (z, z_g, a), one column each.
#[inline(always)]
fn smaller_critic(agent: &Agent, inputs: &[f32], pass: &mut Pass<f32, 3>, values: &mut [f32]) {
    let mut pass = pass.view(values.len());
    let net = &agent.nets.critic.mlp;
    let [critic_0, critic_1] = &agent.critics;
    net.forward(&critic_0.arena, inputs, &mut pass);
    values.copy_from_slice(pass.output());
    net.forward(&critic_1.arena, inputs, &mut pass);
    for (value, &other) in values.iter_mut().zip(pass.output()) {
        *value = value.min(other);
    }
}

#[cfg(test)]
mod tests;
