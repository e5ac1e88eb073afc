//! One training step of soft actor-critic: new tuples, critic targets, critics, actor, temperature, averages.

use super::{
    latent_rollout::{LatentRollout, RolloutBuffers},
    replay::{Replay, Tuple},
    settings::{BATCH, CriticActions, Sac, Temperature},
};
use crate::{
    control::agent::Agent,
    lce::model::LceModel,
    nn::{adam::AdamSettings, columns::Block, heads, mlp::Pass},
    num::{rng::Rng, sampling, simd::vectorize},
};

/// -ln 0.99995.
const TEMPERATURE_DECAY: f32 = 5.000_125e-5;
/// Latent rollouts stay within the data's bounding box, enlarged by this share of its width on every side.
const BOX_MARGIN: f32 = 0.2;

/// What SAC is trained on: codes of the data and of the goal images. It contains no true state.
#[derive(Debug, Clone)]
pub struct Codes {
    /// Gaussians E(·|x) of all observations, one column each.
    pub data: Vec<f32>,
    /// The actions of the data, one column each.
    pub actions: Vec<f32>,
    /// Means of E(·|x_g) of the goal images, one column each.
    pub goals: Vec<f32>,
}

/// Means over the batch of one step.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SacTerms {
    /// The critics' loss J_Q, averaged over both critics.
    pub critic: f64,
    /// The actor's loss J_pi.
    pub actor: f64,
    /// The critics' target.
    pub value: f64,
    /// Entropy of the policy, E[-ln pi].
    pub entropy: f64,
    /// alpha.
    pub temperature: f64,
}

/// Bounds of every latent coordinate, which latent rollouts stay within.
#[derive(Debug)]
pub(super) struct LatentBox {
    pub(super) low: Vec<f32>,
    pub(super) high: Vec<f32>,
}

impl LatentBox {
    /// The box around the means of Gaussian codes, with a margin.
    fn around(gaussians: &[f32], latent: usize) -> Self {
        let (mut low, mut high) = (vec![f32::MAX; latent], vec![f32::MIN; latent]);
        for code in gaussians.chunks_exact(2 * latent) {
            for i in 0..latent {
                (low[i], high[i]) = (low[i].min(code[i]), high[i].max(code[i]));
            }
        }
        for (low, high) in low.iter_mut().zip(&mut high) {
            let margin = (*high - *low) * BOX_MARGIN;
            (*low, *high) = (*low - margin, *high + margin);
        }
        Self { low, high }
    }

    /// One coordinate, moved to the nearest value within the box.
    #[inline(always)]
    pub(super) fn clamp(&self, coordinate: usize, value: f32) -> f32 {
        value.clamp(self.low[coordinate], self.high[coordinate])
    }
}

/// An agent in training.
#[derive(Debug)]
pub struct SacTrainer<'a> {
    /// The agent.
    pub agent: Agent,
    pub(super) model: &'a LceModel,
    pub(super) codes: &'a Codes,
    pub(super) settings: Sac,
    pub(super) bounds: LatentBox,
    pub(super) replay: Replay,
    pub(super) scratch: Scratch,
}

/// Buffers of a step.
#[derive(Debug)]
pub(super) struct Scratch {
    /// (z, a, z', z_g) of the batch.
    pub(super) tuples: Block<f32>,
    /// (z, a) of new tuples before they enter the replay buffer.
    z_u: Block<f32>,
    dynamics: Pass<f32, 3>,
    predicted: Vec<f32>,
    epsilon: Vec<f32>,
    tuple: Vec<f32>,
    pub(super) rollout_noise: Vec<f32>,
    pub(super) rollout: RolloutBuffers,
    pub(super) state_inputs: Block<f32>,
    pub(super) critic_inputs: Block<f32>,
    pub(super) critics: [Pass<f32, 3>; 2],
    pub(super) d_critic_inputs: [Block<f32>; 2],
    pub(super) critic_gradients: [Vec<f32>; 2],
    pub(super) actor: Pass<f32, 3>,
    pub(super) actor_gradient: Vec<f32>,
    pub(super) actor_noise: Vec<f32>,
    pub(super) log_pi: Vec<f32>,
}

impl Scratch {
    fn new(agent: &Agent, model: &LceModel, rollout: usize) -> Self {
        let (n, a, b) = (agent.latent, agent.action, BATCH);
        let critic = || Pass::new(&agent.nets.critic.mlp, b, 1);
        Self {
            tuples: Block::new(Tuple::width(n, a), b),
            z_u: Block::new(n + a, b),
            dynamics: Pass::new(&model.nets.dynamics, b, 1),
            predicted: vec![0.0; 2 * n * b],
            epsilon: vec![0.0; n],
            tuple: vec![0.0; Tuple::width(n, a)],
            rollout_noise: vec![0.0; (rollout + 1) * (a + n) * b],
            rollout: RolloutBuffers::new(agent, model),
            state_inputs: Block::new(2 * n, b),
            critic_inputs: Block::new(2 * n + a, b),
            critics: [(); 2].map(|()| critic()),
            d_critic_inputs: [(); 2].map(|()| Block::new(2 * n + a, b)),
            critic_gradients: [(); 2].map(|()| vec![0.0; agent.nets.critic.layout.len]),
            actor: Pass::new(&agent.nets.actor.mlp, b, 1),
            actor_gradient: vec![0.0; agent.nets.actor.layout.len],
            actor_noise: vec![0.0; a * b],
            log_pi: vec![0.0; b],
        }
    }
}

impl<'a> SacTrainer<'a> {
    /// Trains `agent` on `codes` under the dynamics of `model`. The replay buffer starts empty.
    pub fn new(agent: Agent, model: &'a LceModel, codes: &'a Codes, settings: Sac) -> Self {
        let bounds = LatentBox::around(&codes.data, agent.latent);
        let replay = Replay::new(Tuple::width(agent.latent, agent.action), settings.buffer);
        let scratch = Scratch::new(&agent, model, settings.rollout);
        Self { agent, model, codes, settings, bounds, replay, scratch }
    }

    /// One update of critics, actor and temperature. `learning_rate_scale` multiplies the step sizes of actor and
    /// critics.
    pub fn step(&mut self, threads: usize, learning_rate_scale: f64, rng: &mut Rng) -> SacTerms {
        self.add_tuples(rng);
        let width = self.replay.width;
        for i in 0..BATCH {
            let tuple = self.replay.sample(rng);
            self.scratch.tuples.data[i * width..][..width].copy_from_slice(tuple);
        }
        sampling::fill_normal(rng, &mut self.scratch.rollout_noise);
        sampling::fill_normal(rng, &mut self.scratch.actor_noise);
        self.compute_targets(threads);
        let critic = self.update_critics(threads, learning_rate_scale);
        let (actor, entropy) = self.update_actor(threads, learning_rate_scale);
        self.update_temperature(entropy);
        self.update_averages();
        let value = self.scratch.rollout.target.data.iter().map(|&t| f64::from(t)).sum::<f64>() / BATCH as f64;
        SacTerms { critic, actor, value, entropy, temperature: f64::from(self.agent.temperature()) }
    }

    /// Adds a batch of tuples to the replay buffer: z ~ E(·|x), a, z' ~ F(·|z, a) and z_g.
    fn add_tuples(&mut self, rng: &mut Rng) {
        vectorize(
            #[inline(always)]
            || {
                self.draw_codes_and_actions(rng);
                self.model.predict(&self.scratch.z_u.data, &mut self.scratch.dynamics, &mut self.scratch.predicted);
                self.push_predictions(rng);
            },
        );
    }

    /// Draws z ~ E(·|x) and an action for every new tuple.
    #[inline(always)]
    fn draw_codes_and_actions(&mut self, rng: &mut Rng) {
        let (n, a) = (self.agent.latent, self.agent.action);
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
    fn push_predictions(&mut self, rng: &mut Rng) {
        let (n, a) = (self.agent.latent, self.agent.action);
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
            self.replay.push(tuple);
        }
    }

    /// Fills in the critics' targets of the batch.
    fn compute_targets(&mut self, threads: usize) {
        let Scratch { tuples, rollout_noise, rollout, .. } = &mut self.scratch;
        let latent_rollout = LatentRollout {
            agent: &self.agent,
            model: self.model,
            settings: &self.settings,
            bounds: &self.bounds,
            tuples: &tuples.data,
            noise: rollout_noise,
        };
        latent_rollout.run(threads, rollout);
    }

    /// Moves ln alpha; `entropy` is the policy's entropy in this step.
    pub(super) fn update_temperature(&mut self, entropy: f64) {
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

    /// Moves the target critics and the averaged policy towards the new parameters.
    fn update_averages(&mut self) {
        let agent = &mut self.agent;
        if self.settings.bootstrap {
            for (target, critic) in agent.targets.iter_mut().zip(&agent.critics) {
                polyak(target, &critic.arena, self.settings.tau);
            }
        }
        polyak(&mut agent.acting, &agent.actor.arena, self.settings.policy_ema_rate);
    }
}

/// Polyak averaging: moves `average` towards `new` by the share `rate` of their difference.
fn polyak(average: &mut [f32], new: &[f32], rate: f64) {
    let rate = rate as f32;
    vectorize(
        #[inline(always)]
        || {
            for (average, &new) in average.iter_mut().zip(new) {
                *average = rate.mul_add(new - *average, *average);
            }
        },
    );
}
