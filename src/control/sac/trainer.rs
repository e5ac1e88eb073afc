//! One training step of soft actor-critic: new tuples, critic targets, critics, actor, temperature, averages.

use super::{
    latent_box::LatentBox,
    latent_rollout::{LatentRollout, RolloutBuffers},
    learner::Learner,
    replay::Tuple,
    rollout_dynamics::RolloutDynamics,
    settings::{BATCH, Sac, Temperature, Tuning},
    speeds::{Antifriction, distance_factors},
};
use crate::{
    control::agent::Agent,
    lce::{Ensemble, LceModel, dynamics::DynamicsPass},
    nn::{adam::AdamSettings, columns::Block, mlp::Pass},
    num::{sampling, simd::vectorize},
};

/// -ln 0.99995.
const TEMPERATURE_DECAY: f32 = 5.000_125e-5;

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

/// Trains an agent on the codes of data, under a model's dynamics.
#[derive(Debug)]
pub struct SacTrainer<'a> {
    /// What training changes.
    pub learner: Learner,
    pub(super) model: &'a LceModel,
    pub(super) dynamics: RolloutDynamics<'a>,
    pub(super) codes: &'a Codes,
    pub(super) settings: Sac,
    pub(super) bounds: LatentBox,
    pub(super) distance_factors: Vec<f32>,
    pub(super) antifriction: Option<Antifriction>,
    pub(super) scratch: Scratch,
    pub(super) is_finite: bool,
}

/// Buffers of a step.
#[derive(Debug)]
pub(super) struct Scratch {
    /// (z, a, z', z_g) of the batch.
    pub(super) tuples: Block<f32>,
    /// (z, a) of new tuples before they enter the replay buffer.
    pub(super) z_u: Block<f32>,
    pub(super) dynamics: DynamicsPass<f32>,
    pub(super) predicted: Vec<f32>,
    pub(super) epsilon: Vec<f32>,
    pub(super) tuple: Vec<f32>,
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
            dynamics: DynamicsPass::new(&model.nets.dynamics, b, 1),
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
    /// Trains `learner` on `codes` under the dynamics of `model`.
    pub fn new(learner: Learner, model: &'a LceModel, codes: &'a Codes, settings: Sac) -> Self {
        let bounds = LatentBox::around(&codes.data, learner.agent.latent);
        let scratch = Scratch::new(&learner.agent, model, settings.rollout);
        let distance_factors = distance_factors(model, settings.speed_weight, &codes.data, &codes.goals);
        let antifriction = Antifriction::new(model, settings.antifriction, BATCH);
        let dynamics = RolloutDynamics::of_model(model);
        Self {
            learner,
            model,
            dynamics,
            codes,
            settings,
            bounds,
            distance_factors,
            antifriction,
            scratch,
            is_finite: true,
        }
    }

    /// Lets latent rollouts follow the members of an ensemble instead of the model's F, each member for an equal share of
    /// a batch. The step before a rollout, from z to z', follows the model's F.
    #[must_use]
    pub fn with_ensemble(self, ensemble: &'a Ensemble) -> Self {
        Self { dynamics: RolloutDynamics::of_ensemble(ensemble), ..self }
    }

    /// Whether the last update left finite parameters and moments of critics, actor and temperature.
    pub fn is_finite(&self) -> bool {
        self.is_finite
    }

    /// One update of critics, actor and temperature. `learning_rate_scale` multiplies the step sizes of actor and
    /// critics.
    pub fn step(&mut self, threads: usize, learning_rate_scale: f64) -> SacTerms {
        self.is_finite = true;
        self.add_tuples();
        let Learner { buffer, rng, .. } = &mut self.learner;
        for tuple in self.scratch.tuples.data.chunks_exact_mut(buffer.width) {
            tuple.copy_from_slice(buffer.sample(rng));
        }
        sampling::fill_normal(rng, &mut self.scratch.rollout_noise);
        sampling::fill_normal(rng, &mut self.scratch.actor_noise);
        if let Some(antifriction) = &mut self.antifriction {
            antifriction.draw(rng);
        }
        self.compute_targets(threads);
        let critic = self.update_critics(threads, learning_rate_scale);
        let (actor, entropy) = self.update_actor(threads, learning_rate_scale);
        self.update_temperature(entropy);
        self.update_averages();
        self.learner.steps += 1;
        let value = self.scratch.rollout.target.data.iter().map(|&t| f64::from(t)).sum::<f64>() / BATCH as f64;
        SacTerms { critic, actor, value, entropy, temperature: f64::from(self.learner.agent.temperature()) }
    }

    /// Fills in the critics' targets of the batch.
    pub(super) fn compute_targets(&mut self, threads: usize) {
        let Scratch { tuples, rollout_noise, rollout, .. } = &mut self.scratch;
        let latent_rollout = LatentRollout {
            agent: &self.learner.agent,
            dynamics: &self.dynamics,
            settings: &self.settings,
            bounds: &self.bounds,
            distance_factors: &self.distance_factors,
            antifriction: self.antifriction.as_ref(),
            tuples: &tuples.data,
            noise: rollout_noise,
        };
        latent_rollout.run(threads, rollout);
    }

    /// Moves ln alpha; `entropy` is the policy's entropy in this step.
    pub(super) fn update_temperature(&mut self, entropy: f64) {
        let agent = &mut self.learner.agent;
        match self.settings.temperature {
            Temperature::Fixed => {}
            Temperature::Decayed => agent.log_alpha.arena[0] -= TEMPERATURE_DECAY,
            Temperature::Tuned(Tuning { learning_rate }) => {
                let gradient = [(entropy + agent.action as f64) as f32];
                let settings = AdamSettings { learning_rate, weight_decay: 0.0 };
                self.is_finite &= agent.log_alpha.adam.step(1, settings, &mut agent.log_alpha.arena, &gradient);
            }
        }
    }

    /// Moves the target critics and the averaged policy towards the new parameters.
    fn update_averages(&mut self) {
        let agent = &mut self.learner.agent;
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
