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
mod tests {
    use rand::SeedableRng as _;

    use super::*;
    use crate::num::{math, simd::tests::on_every_instruction_set};

    fn exact(temperature: f64) -> Guidance {
        Guidance { temperature, discount: 0.5, bound: 30.0, normalize: false, ..Guidance::default() }
    }

    #[test]
    fn weights_are_the_papers_exponentials() {
        // tau/gamma = 1/2: exponents 0, ln 2 and -ln 4.
        let (two, four) = (math::ln(2.0), math::ln(4.0));
        let weights = exact(0.25).weights(&[0.0, 2.0 * two, -2.0 * four]);
        for (weight, want) in weights.iter().zip([1.0, 2.0, 0.25]) {
            assert!((weight - want).abs() < 1e-6, "{weights:?}");
        }
        assert_eq!(exact(0.0).weights(&[-3.0, 0.0, 1e9]), [1.0; 3]);
    }

    #[test]
    fn normalized_weights_have_mean_one_and_ignore_a_constant_in_all_errors() {
        let guidance = Guidance { normalize: true, ..exact(0.25) };
        let errors = [-4.0, 0.5, 1.0, 3.0, -20.0];
        let weights = guidance.weights(&errors);
        assert!((weights.iter().sum::<f32>() / 5.0 - 1.0).abs() < 1e-6);
        let shifted = guidance.weights(&errors.map(|error| error - 1000.0));
        assert!(weights.iter().zip(shifted).all(|(a, b)| (a - b).abs() < 1e-3 * a));
        assert!((weights[3] / weights[1] - (0.25 * 2.5 / 0.5_f32).e_to()).abs() < 1e-4, "ratios stay exponential");
    }

    #[test]
    fn no_reward_makes_a_weight_overflow() {
        let quadratic = [-6946.0, -4398.0, -1108.0, 600.0, 2630.0];
        let bounded = Guidance { bound: 2.0, ..Guidance::default() }.weights(&quadratic);
        let spread = Spread::of(&bounded);
        assert!(
            spread.effective_share > 0.3 && spread.largest / spread.smallest <= 4.0_f64.exp() * 1.001,
            "{spread:?}"
        );
        assert!(Guidance { bound: 30.0, ..exact(1.0) }.weights(&quadratic).iter().all(|weight| weight.is_finite()));
    }

    #[test]
    fn the_effective_share_counts_transitions_that_matter() {
        assert_eq!(Spread::of(&[2.0; 7]), Spread { effective_share: 1.0, smallest: 2.0, largest: 2.0 });
        assert_eq!(Spread::of(&[1.0, 0.0, 0.0, 0.0]).effective_share, 0.25);
    }

    /// One transition with noiseless codes; critics and actor return constants.
    #[test]
    fn a_td_error_is_reward_minus_q_plus_the_discounted_soft_value() {
        let mut rng = Rng::seed_from_u64(3);
        let alpha = 0.25_f32;
        let mut agent = Agent::new(2, 1, None, math::ln(alpha), &mut rng);
        for (critic, value) in agent.critics.iter_mut().zip([-2.0, -3.0]) {
            critic.arena.fill(0.0);
            *critic.arena.last_mut().expect("a bias") = value;
        }
        // tanh(0 + sigma epsilon) with the smallest sigma: ln pi is known up to epsilon.
        agent.acting.fill(0.0);
        *agent.acting.last_mut().expect("a bias") = -5.0;
        let certain = [-87.0; 2];
        let [now, next] = [[0.0, 0.0], [3.0, 4.0]].map(|mean| [mean, certain].concat());
        let transitions = LatentTransitions { now: &now, next: &next, actions: &[0.5], goals: &[0.0, 0.0] };
        let guidance = Guidance { samples: 4000, ..exact(1.0) };
        let error = guidance.td_errors(&agent, &transitions, &mut rng)[0];
        // r = -5, Q = -3, V = -3 - alpha E[ln pi], E[ln pi] = -1/2 - ln sigma - ln(2 pi)/2 = 3.5811 where tanh is flat.
        let want = -5.0 + 3.0 + 0.5 * (-3.0 - alpha * 3.5811);
        assert!((error - want).abs() < 0.02, "{error} is not {want}");
        let kappa = Guidance { reward: Reward::Quadratic, samples: 1, ..exact(1.0) };
        let other = kappa.td_errors(&agent, &transitions, &mut rng)[0];
        assert!((other - error + 50.0 * 25.0 + 0.25 - 5.0).abs() < 1.0, "{other}");
    }

    #[test]
    fn every_instruction_set_gives_the_same_errors_and_chunks_do_not_matter() {
        let mut rng = Rng::seed_from_u64(4);
        let agent = Agent::new(3, 2, None, 0.0, &mut rng);
        let count = AT_ONCE + 9;
        let [mut now, mut next, mut actions, mut goals] = [6, 6, 2, 3].map(|width| vec![0.0_f32; width * count]);
        for columns in [&mut now, &mut next, &mut actions, &mut goals] {
            sampling::fill_normal(&mut rng, columns);
        }
        let transitions = LatentTransitions { now: &now, next: &next, actions: &actions, goals: &goals };
        let guidance = Guidance { samples: 2, ..Guidance::default() };
        on_every_instruction_set(|| {
            let errors = guidance.td_errors(&agent, &transitions, &mut Rng::seed_from_u64(5));
            errors.iter().map(|error| error.to_bits()).collect::<Vec<_>>()
        });
        let first = LatentTransitions {
            now: &now[..6 * AT_ONCE],
            next: &next[..6 * AT_ONCE],
            actions: &actions[..2 * AT_ONCE],
            goals: &goals[..3 * AT_ONCE],
        };
        let all = guidance.td_errors(&agent, &transitions, &mut Rng::seed_from_u64(5));
        assert_eq!(guidance.td_errors(&agent, &first, &mut Rng::seed_from_u64(5)), all[..AT_ONCE]);
    }
}
