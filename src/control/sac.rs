//! Model-based soft actor-critic in the latent space (paper, "Soft Actor Critic (SAC) Updates"): the critics' targets
//! come from rolling the learned dynamics out for k steps under the current policy.

mod targets;

use targets::{RollOut, Rollout};

use super::agent::{Agent, clamp_log_sigma, log_sigma_is_free, squash};
use crate::{
    lce::LceModel,
    nn::{adam::AdamSettings, columns::Block, heads, mat::Accumulate, mlp::Pass},
    num::{Real, join, rng::Rng, sampling, simd::vectorize},
};

/// The reward of reaching z'.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Reward {
    /// -|z_g - z'|, as in the paper's algorithm.
    Distance,
    /// -50 |z_g - z'|² - |a|², as in the paper's appendix.
    Quadratic,
}

/// The temperature alpha.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Temperature {
    /// Tuned towards an entropy of minus the number of action components.
    Tuned,
    /// Stays what it is at the start.
    Fixed,
    /// Multiplied by 0.99995 at every step.
    Decayed,
}

/// Which actions the critics are trained at.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum CriticActions {
    /// Uniformly random ones, since the model knows where they lead.
    Uniform,
    /// Those of the data.
    Data,
}

/// Constants of the algorithm.
#[derive(Debug, Clone, PartialEq)]
pub struct Sac {
    /// gamma.
    pub discount: f64,
    /// k, the latent rollout behind a target.
    pub rollout: usize,
    /// Whether a target ends with the target critics' value.
    pub bootstrap: bool,
    /// Share of new critics in their targets, nu.
    pub target_rate: f64,
    /// Share of new parameters in the acting average of the actor.
    pub acting_rate: f64,
    /// Step size of the actor.
    pub actor_learning_rate: f64,
    /// Step size of the critics.
    pub critic_learning_rate: f64,
    /// How alpha moves.
    pub temperature: Temperature,
    /// Step size of ln alpha.
    pub temperature_learning_rate: f64,
    /// The reward.
    pub reward: Reward,
    /// Share of goals that are codes of the data instead of goal images.
    pub relabel: f64,
    /// Where the critics are trained.
    pub critic_actions: CriticActions,
    /// Capacity of the latent buffer.
    pub buffer: usize,
}

/// Tuples of a batch (paper, Table "Hyper parameters for the SAC controller").
pub const BATCH: usize = 128;
/// Tuples that the buffer has room for from the start, so that steps do not allocate; untouched memory costs nothing.
const RESERVED: usize = 1 << 20;
/// -ln 0.99995.
const TEMPERATURE_DECAY: f32 = 5.000_125e-5;
/// Rollouts stay within the data's box, enlarged by this share on every side.
const BOX_MARGIN: f32 = 0.2;

/// What SAC is trained on: codes of the data and of the goal images. No state is in it.
#[derive(Debug, Clone)]
pub struct Codes {
    /// Gaussians E(·|x) of all observations, one column each.
    pub data: Vec<f32>,
    /// Actions taken there, one column each.
    pub actions: Vec<f32>,
    /// Means of E(·|x_g) of the goal images.
    pub goals: Vec<f32>,
}

/// Means over one step, for the curves.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SacTerms {
    /// Loss of the critics.
    pub critic: f64,
    /// Loss of the actor.
    pub actor: f64,
    /// Mean target.
    pub value: f64,
    /// Entropy of the policy, -ln pi.
    pub entropy: f64,
    /// alpha.
    pub temperature: f64,
}

/// The latent buffer B_latent: (z, a, z', z_g), one column each; the oldest go first.
#[derive(Debug)]
struct Buffer {
    columns: Vec<f32>,
    width: usize,
    capacity: usize,
    next: usize,
}

impl Buffer {
    fn push(&mut self, column: &[f32]) {
        if self.columns.len() < self.capacity * self.width {
            self.columns.extend_from_slice(column);
        } else {
            self.columns[self.next * self.width..][..self.width].copy_from_slice(column);
        }
        self.next = (self.next + 1) % self.capacity;
    }

    fn sample(&self, rng: &mut Rng) -> &[f32] {
        &self.columns[sampling::index(rng, self.columns.len() / self.width) * self.width..][..self.width]
    }
}

/// An agent in training.
#[derive(Debug)]
pub struct SacTrainer<'a> {
    /// The agent.
    pub agent: Agent,
    model: &'a LceModel,
    codes: &'a Codes,
    settings: Sac,
    low: Vec<f32>,
    high: Vec<f32>,
    buffer: Buffer,
    scratch: Scratch,
}

#[derive(Debug)]
struct Scratch {
    /// (z, a, z', z_g) of the batch.
    tuples: Block<f32>,
    /// Fresh tuples before they enter the buffer.
    z_u: Block<f32>,
    dynamics: Pass<f32, 3>,
    predicted: Vec<f32>,
    epsilon: Vec<f32>,
    tuple: Vec<f32>,
    rollout_noise: Vec<f32>,
    rollout: Rollout,
    state_inputs: Block<f32>,
    critic_inputs: Block<f32>,
    critics: [Pass<f32, 3>; 2],
    d_critic_inputs: [Block<f32>; 2],
    critic_gradients: [Vec<f32>; 2],
    actor: Pass<f32, 3>,
    actor_gradient: Vec<f32>,
    actor_noise: Vec<f32>,
    log_pi: Vec<f32>,
}

impl Scratch {
    fn new(agent: &Agent, model: &LceModel, rollout: usize) -> Self {
        let (n, a, b) = (agent.latent, agent.action, BATCH);
        let critic = || Pass::new(&agent.nets.critic.1, b, 1);
        let actor = || Pass::new(&agent.nets.actor.1, b, 1);
        let dynamics = || Pass::new(&model.nets.dynamics, b, 1);
        Self {
            tuples: Block::new(3 * n + a, b),
            z_u: Block::new(n + a, b),
            dynamics: dynamics(),
            predicted: vec![0.0; 2 * n * b],
            epsilon: vec![0.0; n],
            tuple: vec![0.0; 3 * n + a],
            rollout_noise: vec![0.0; (rollout + 1) * (a + n) * b],
            rollout: Rollout::new(agent, model),
            state_inputs: Block::new(2 * n, b),
            critic_inputs: Block::new(2 * n + a, b),
            critics: [(); 2].map(|()| critic()),
            d_critic_inputs: [(); 2].map(|()| Block::new(2 * n + a, b)),
            critic_gradients: [(); 2].map(|()| vec![0.0; agent.nets.critic.0.len]),
            actor: actor(),
            actor_gradient: vec![0.0; agent.nets.actor.0.len],
            actor_noise: vec![0.0; a * b],
            log_pi: vec![0.0; b],
        }
    }
}

impl<'a> SacTrainer<'a> {
    /// Goes on training `agent` on `codes` under the dynamics of `model`.
    pub fn new(agent: Agent, model: &'a LceModel, codes: &'a Codes, settings: Sac) -> Self {
        let n = agent.latent;
        let (mut low, mut high) = (vec![f32::MAX; n], vec![f32::MIN; n]);
        for code in codes.data.chunks_exact(2 * n) {
            for i in 0..n {
                (low[i], high[i]) = (low[i].min(code[i]), high[i].max(code[i]));
            }
        }
        for (low, high) in low.iter_mut().zip(&mut high) {
            let margin = (*high - *low) * BOX_MARGIN;
            (*low, *high) = (*low - margin, *high + margin);
        }
        let width = 3 * n + agent.action;
        let columns = Vec::with_capacity(settings.buffer.min(RESERVED) * width);
        let buffer = Buffer { columns, width, capacity: settings.buffer, next: 0 };
        let scratch = Scratch::new(&agent, model, settings.rollout);
        Self { agent, model, codes, settings, low, high, buffer, scratch }
    }

    /// One update of critics, actor and temperature. `pace` scales the step sizes of actor and critics.
    pub fn step(&mut self, threads: usize, pace: f64, rng: &mut Rng) -> SacTerms {
        self.fill_buffer(rng);
        let width = self.buffer.width;
        for i in 0..BATCH {
            let tuple = self.buffer.sample(rng);
            self.scratch.tuples.data[i * width..][..width].copy_from_slice(tuple);
        }
        sampling::fill_normal(rng, &mut self.scratch.rollout_noise);
        sampling::fill_normal(rng, &mut self.scratch.actor_noise);
        self.roll_out(threads);
        let critic = self.update_critics(threads, pace);
        let (actor, entropy) = self.update_actor(threads, pace);
        self.update_temperature(entropy);
        self.average();
        let value = self.scratch.rollout.target.data.iter().map(|&t| f64::from(t)).sum::<f64>() / BATCH as f64;
        SacTerms { critic, actor, value, entropy, temperature: f64::from(self.agent.temperature()) }
    }

    /// z ~ E(·|x), a, z' ~ F(·|z, a) and z_g for a batch, into the buffer.
    fn fill_buffer(&mut self, rng: &mut Rng) {
        vectorize(
            #[inline(always)]
            || self.fresh_tuples(rng),
        );
    }

    #[inline(always)]
    fn fresh_tuples(&mut self, rng: &mut Rng) {
        let (n, a) = (self.agent.latent, self.agent.action);
        let s = &mut self.scratch;
        let count = self.codes.data.len() / (2 * n);
        let mut epsilon = std::mem::take(&mut s.epsilon);
        for i in 0..BATCH {
            let which = sampling::index(rng, count);
            sampling::fill_normal(rng, &mut epsilon);
            let (z, u) = s.z_u.data[i * (n + a)..][..n + a].split_at_mut(n);
            heads::sample(&self.codes.data[which * 2 * n..][..2 * n], &epsilon, z);
            match self.settings.critic_actions {
                CriticActions::Uniform => u.fill_with(|| sampling::uniform(rng, -1.0, 1.0)),
                CriticActions::Data => u.copy_from_slice(&self.codes.actions[which * a..][..a]),
            }
        }
        self.model.predict(&s.z_u.data, &mut s.dynamics, &mut s.predicted);
        let goals = self.codes.goals.len() / n;
        let mut tuple = std::mem::take(&mut s.tuple);
        for i in 0..BATCH {
            sampling::fill_normal(rng, &mut epsilon);
            tuple[..n + a].copy_from_slice(&s.z_u.data[i * (n + a)..][..n + a]);
            let next = &mut tuple[n + a..2 * n + a];
            heads::sample(&s.predicted[i * 2 * n..][..2 * n], &epsilon, next);
            for k in 0..n {
                next[k] = next[k].clamp(self.low[k], self.high[k]);
            }
            let goal = if f64::from(sampling::uniform(rng, 0.0, 1.0)) < self.settings.relabel {
                &self.codes.data[sampling::index(rng, count) * 2 * n..][..n]
            } else {
                &self.codes.goals[sampling::index(rng, goals) * n..][..n]
            };
            tuple[2 * n + a..].copy_from_slice(goal);
            self.buffer.push(&tuple);
        }
        s.tuple = tuple;
        s.epsilon = epsilon;
    }

    /// The critics' targets of the batch.
    fn roll_out(&mut self, threads: usize) {
        let s = &mut self.scratch;
        let roll_out = RollOut {
            agent: &self.agent,
            model: self.model,
            settings: &self.settings,
            low: &self.low,
            high: &self.high,
            tuples: &s.tuples.data,
            noise: &s.rollout_noise,
        };
        roll_out.run(threads, &mut s.rollout);
    }

    /// Regresses both critics on the targets: J_Q.
    fn update_critics(&mut self, threads: usize, pace: f64) -> f64 {
        let (n, a, width) = (self.agent.latent, self.agent.action, self.buffer.width);
        let s = &mut self.scratch;
        for i in 0..BATCH {
            let tuple = &s.tuples.data[i * width..][..width];
            let input = &mut s.state_inputs.data[i * 2 * n..][..2 * n];
            self.agent.input(&tuple[..n], &tuple[2 * n + a..], input);
            let critic_input = &mut s.critic_inputs.data[i * (2 * n + a)..][..2 * n + a];
            critic_input[..2 * n].copy_from_slice(input);
            critic_input[2 * n..].copy_from_slice(&tuple[n..n + a]);
        }
        let settings = AdamSettings { learning_rate: self.settings.critic_learning_rate * pace, weight_decay: 0.0 };
        let net = self.agent.nets.critic.1;
        let (inputs, targets) = (&s.critic_inputs.data, &s.rollout.target.data);
        let update = |trained: &mut super::agent::Trained, pass: &mut Pass<f32, 3>, gradient: &mut [f32]| {
            let mut pass = pass.view(BATCH);
            net.forward(&trained.arena, inputs, &mut pass);
            let mut loss = 0.0;
            for i in 0..BATCH {
                let error = pass.out[2][i] - targets[i];
                loss += 0.5 * f64::from(error * error);
                pass.delta[2][i] = error / BATCH as f32;
            }
            net.backward(&trained.arena, &mut pass, None);
            net.gradient(1, gradient, Accumulate::Replace, inputs, &pass);
            trained.adam.step(1, settings, &mut trained.arena, gradient);
            loss / BATCH as f64
        };
        let [critic_0, critic_1] = &mut self.agent.critics;
        let [pass_0, pass_1] = &mut s.critics;
        let [gradient_0, gradient_1] = &mut s.critic_gradients;
        let (loss_0, loss_1) =
            join(threads, || update(critic_0, pass_0, gradient_0), || update(critic_1, pass_1, gradient_1));
        0.5 * (loss_0 + loss_1)
    }

    /// Moves the policy towards the exponential of the smaller critic: J_pi. Gives the loss and the entropy.
    fn update_actor(&mut self, threads: usize, pace: f64) -> (f64, f64) {
        vectorize(
            #[inline(always)]
            || self.actor_step(threads, pace),
        )
    }

    #[inline(always)]
    fn actor_step(&mut self, threads: usize, pace: f64) -> (f64, f64) {
        let (n, a) = (self.agent.latent, self.agent.action);
        let (actor_net, critic_net) = (self.agent.nets.actor.1, self.agent.nets.critic.1);
        let alpha = self.agent.temperature();
        let s = &mut self.scratch;
        let mut actor = s.actor.view(BATCH);
        actor_net.forward(&self.agent.actor.arena, &s.state_inputs.data, &mut actor);
        for i in 0..BATCH {
            let gaussian = &mut actor.out[2][i * 2 * a..][..2 * a];
            // The raw log standard deviation is kept in the delta until the gradient has asked for it.
            actor.delta[2][i * 2 * a..][..2 * a].copy_from_slice(gaussian);
            clamp_log_sigma(&mut gaussian[a..]);
            let input = &mut s.critic_inputs.data[i * (2 * n + a)..][..2 * n + a];
            s.log_pi[i] = squash(gaussian, &s.actor_noise[i * a..][..a], &mut input[2 * n..]);
        }
        let [critic_0, critic_1] = &self.agent.critics;
        let [pass_0, pass_1] = &mut s.critics;
        let (mut pass_0, mut pass_1) = (pass_0.view(BATCH), pass_1.view(BATCH));
        let inputs = &s.critic_inputs.data;
        join(
            threads,
            || critic_net.forward(&critic_0.arena, inputs, &mut pass_0),
            || critic_net.forward(&critic_1.arena, inputs, &mut pass_1),
        );
        let mut loss = 0.0;
        for i in 0..BATCH {
            let (q_0, q_1) = (pass_0.out[2][i], pass_1.out[2][i]);
            let slope = -1.0 / BATCH as f32;
            (pass_0.delta[2][i], pass_1.delta[2][i]) = if q_0 < q_1 { (slope, 0.0) } else { (0.0, slope) };
            loss += f64::from(alpha * s.log_pi[i] - q_0.min(q_1));
        }
        let [d_input_0, d_input_1] = &mut s.d_critic_inputs;
        join(
            threads,
            || critic_net.backward(&critic_0.arena, &mut pass_0, Some(&mut d_input_0.data)),
            || critic_net.backward(&critic_1.arena, &mut pass_1, Some(&mut d_input_1.data)),
        );
        for i in 0..BATCH {
            let at = i * (2 * n + a) + 2 * n;
            for k in 0..a {
                let (mu, sigma) = (i * 2 * a + k, i * 2 * a + a + k);
                let action = inputs[at + k];
                let d_action = d_input_0.data[at + k] + d_input_1.data[at + k];
                let d_pre = alpha / BATCH as f32 * 2.0 * action + d_action * (1.0 - action * action);
                let free = log_sigma_is_free(actor.delta[2][sigma]);
                let spread = actor.out[2][sigma].e_to() * s.actor_noise[i * a + k];
                actor.delta[2][mu] = d_pre;
                actor.delta[2][sigma] = if free { d_pre * spread - alpha / BATCH as f32 } else { 0.0 };
            }
        }
        actor_net.backward(&self.agent.actor.arena, &mut actor, None);
        actor_net.gradient(1, &mut s.actor_gradient, Accumulate::Replace, &s.state_inputs.data, &actor);
        let settings = AdamSettings { learning_rate: self.settings.actor_learning_rate * pace, weight_decay: 0.0 };
        self.agent.actor.adam.step(1, settings, &mut self.agent.actor.arena, &s.actor_gradient);
        let entropy = -s.log_pi.iter().map(|&l| f64::from(l)).sum::<f64>() / BATCH as f64;
        (loss / BATCH as f64, entropy)
    }

    fn update_temperature(&mut self, entropy: f64) {
        match self.settings.temperature {
            Temperature::Fixed => {}
            Temperature::Decayed => self.agent.log_alpha.arena[0] -= TEMPERATURE_DECAY,
            Temperature::Tuned => {
                let gradient = [(entropy + self.agent.action as f64) as f32];
                let learning_rate = self.settings.temperature_learning_rate;
                let settings = AdamSettings { learning_rate, weight_decay: 0.0 };
                self.agent.log_alpha.adam.step(1, settings, &mut self.agent.log_alpha.arena, &gradient);
            }
        }
    }

    fn average(&mut self) {
        let agent = &mut self.agent;
        if self.settings.bootstrap {
            for (target, critic) in agent.targets.iter_mut().zip(&agent.critics) {
                approach(target, &critic.arena, self.settings.target_rate);
            }
        }
        approach(&mut agent.acting, &agent.actor.arena, self.settings.acting_rate);
    }
}

/// Moves `slow` towards `fast` by a share of the difference (Polyak averaging).
fn approach(slow: &mut [f32], fast: &[f32], share: f64) {
    let share = share as f32;
    vectorize(
        #[inline(always)]
        || {
            for (slow, &fast) in slow.iter_mut().zip(fast) {
                *slow = share.mul_add(fast - *slow, *slow);
            }
        },
    );
}

#[cfg(test)]
mod tests;
