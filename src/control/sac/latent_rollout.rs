//! The critics' targets, from latent rollouts: k steps of the learned dynamics under the current policy.
//!
//! A target is r(z') + Σ gamma^(i+1) (r - alpha ln pi) over the rollout. Where targets bootstrap, the target critics'
//! value at the end of the rollout is added (paper, equation "SAC Q Update").

use super::{
    latent_box::LatentBox,
    replay::Tuple,
    rollout_dynamics::RolloutDynamics,
    settings::{BATCH, Sac},
    speeds::Antifriction,
};
use crate::{
    control::agent::{Agent, clamp_log_sigma, squash},
    lce::{
        dynamics::{DynamicsColumns, DynamicsPass},
        model::LceModel,
    },
    nn::{
        columns::{Block, BlockMut, Cut as _, cut_together, over_samples},
        mlp::{Pass, PassMut},
    },
    num::{Real as _, simd::vectorize},
};

/// Buffers of a latent rollout, and the targets it computes.
#[derive(Debug)]
pub(super) struct RolloutBuffers {
    z: Block<f32>,
    inputs: Block<f32>,
    actor: Pass<f32, 3>,
    z_u: Block<f32>,
    dynamics: DynamicsPass<f32>,
    critic_inputs: Block<f32>,
    critic: Pass<f32, 3>,
    /// The critics' target of every sample.
    pub(super) target: Block<f32>,
}

cut_together! {
    struct RolloutColumns<'a, T> {
        z: BlockMut<'a, T>,
        inputs: BlockMut<'a, T>,
        actor: PassMut<'a, T, 3>,
        z_u: BlockMut<'a, T>,
        dynamics: DynamicsColumns<'a, T>,
        critic_inputs: BlockMut<'a, T>,
        critic: PassMut<'a, T, 3>,
        target: BlockMut<'a, T>,
    }
}

impl RolloutBuffers {
    pub(super) fn new(agent: &Agent, model: &LceModel) -> Self {
        let (n, a, b) = (agent.latent, agent.action, BATCH);
        Self {
            z: Block::new(n, b),
            inputs: Block::new(2 * n, b),
            actor: Pass::new(&agent.nets.actor.mlp, b, 1),
            z_u: Block::new(n + a, b),
            dynamics: DynamicsPass::new(&model.nets.dynamics, b, 1),
            critic_inputs: Block::new(2 * n + a, b),
            critic: Pass::new(&agent.nets.critic.mlp, b, 1),
            target: Block::new(1, b),
        }
    }

    fn view(&mut self) -> RolloutColumns<'_, f32> {
        RolloutColumns {
            z: self.z.view(BATCH),
            inputs: self.inputs.view(BATCH),
            actor: self.actor.view(BATCH),
            z_u: self.z_u.view(BATCH),
            dynamics: self.dynamics.view(BATCH),
            critic_inputs: self.critic_inputs.view(BATCH),
            critic: self.critic.view(BATCH),
            target: self.target.view(BATCH),
        }
    }
}

/// What all samples of a latent rollout share.
pub(super) struct LatentRollout<'a> {
    pub(super) agent: &'a Agent,
    pub(super) dynamics: &'a RolloutDynamics<'a>,
    pub(super) settings: &'a Sac,
    /// The box that codes stay within.
    pub(super) bounds: &'a LatentBox,
    /// Factors on the coordinates of the distance to the goal.
    pub(super) distance_factors: &'a [f32],
    pub(super) antifriction: Option<&'a Antifriction>,
    /// (z, a, z', z_g) of the batch.
    pub(super) tuples: &'a [f32],
    /// Standard normal noise, for every step and every sample of the batch: first for the action, then for the code.
    pub(super) noise: &'a [f32],
}

impl<'a> LatentRollout<'a> {
    /// Fills in the targets of the batch.
    pub(super) fn run(&self, threads: usize, buffers: &mut RolloutBuffers) {
        let n = self.agent.latent;
        for (i, z) in buffers.z.data.chunks_exact_mut(n).enumerate() {
            z.copy_from_slice(self.tuple(i).z_next);
        }
        let mut rest = buffers.view();
        for (member, share) in self.dynamics.shares(BATCH).enumerate() {
            let (columns, others) = rest.cut(share.len());
            over_samples(threads, share.start, share.len(), columns, &|first, samples, columns| {
                self.run_samples(member, first, samples, columns);
            });
            rest = others;
        }
    }

    fn run_samples(&self, member: usize, first: usize, samples: usize, mut c: RolloutColumns<'_, f32>) {
        vectorize(
            #[inline(always)]
            || {
                for i in 0..samples {
                    let Tuple { action, z_goal, .. } = self.tuple(first + i);
                    c.target.sample(i)[0] = self.reward(action, c.z.sample(i), z_goal);
                }
                let mut discount = 1.0_f32;
                for step in 0..self.settings.rollout {
                    discount *= self.settings.discount as f32;
                    self.choose_actions(step, discount, first, samples, &mut c);
                    self.follow_dynamics(member, (step, discount), first, samples, &mut c);
                }
                if self.settings.bootstrap {
                    discount *= self.settings.discount as f32;
                    self.choose_actions(self.settings.rollout, discount, first, samples, &mut c);
                    self.add_values(samples, discount, &mut c);
                }
            },
        );
    }

    #[inline(always)]
    fn reward(&self, action: &[f32], z: &[f32], z_goal: &[f32]) -> f32 {
        let differences = z.iter().zip(z_goal).zip(self.distance_factors).map(|((z, g), factor)| (z - g) * factor);
        self.settings.reward.at(action, differences)
    }

    #[inline(always)]
    fn tuple(&self, sample: usize) -> Tuple<'a> {
        let (n, a) = (self.agent.latent, self.agent.action);
        let width = Tuple::width(n, a);
        Tuple::read(&self.tuples[sample * width..][..width], n, a)
    }

    /// The noise of one step for one sample: of the action, and of the code.
    #[inline(always)]
    fn noise(&self, step: usize, sample: usize) -> (&'a [f32], &'a [f32]) {
        let (n, a) = (self.agent.latent, self.agent.action);
        self.noise[(step * BATCH + sample) * (a + n)..][..a + n].split_at(a)
    }

    /// Samples a ~ pi(·|z), and subtracts the discounted alpha ln pi(a|z) from the targets.
    #[inline(always)]
    fn choose_actions(
        &self,
        step: usize,
        discount: f32,
        first: usize,
        samples: usize,
        c: &mut RolloutColumns<'_, f32>,
    ) {
        let (n, a) = (self.agent.latent, self.agent.action);
        let alpha = self.agent.temperature();
        for i in 0..samples {
            self.agent.input(c.z.sample(i), self.tuple(first + i).z_goal, c.inputs.sample(i));
        }
        self.agent.nets.actor.mlp.forward(&self.agent.actor.arena, c.inputs.data, &mut c.actor);
        let (gaussians, _) = c.actor.output_and_delta();
        for (i, gaussian) in gaussians.chunks_exact_mut(2 * a).enumerate() {
            let (epsilon, _) = self.noise(step, first + i);
            clamp_log_sigma(&mut gaussian[a..]);
            let (z, action) = c.z_u.sample(i).split_at_mut(n);
            let log_pi = squash(gaussian, epsilon, action);
            z.copy_from_slice(c.z.sample(i));
            c.target.sample(i)[0] -= discount * alpha * log_pi;
        }
    }

    /// Samples z' ~ F(·|z, a), and adds the discounted reward to the targets.
    #[inline(always)]
    fn follow_dynamics(
        &self,
        member: usize,
        (step, discount): (usize, f32),
        first: usize,
        samples: usize,
        c: &mut RolloutColumns<'_, f32>,
    ) {
        let n = self.agent.latent;
        self.dynamics.net.forward(self.dynamics.members[member], c.z_u.data, &mut c.dynamics);
        let (gaussians, _) = c.dynamics.output_and_delta();
        for (i, gaussian) in gaussians.chunks_exact_mut(2 * n).enumerate().take(samples) {
            let (_, epsilon) = self.noise(step, first + i);
            let z = c.z.sample(i);
            if let Some(antifriction) = self.antifriction {
                antifriction.push(first + i, z, gaussian);
            }
            for k in 0..n {
                // F's means are relative to z.
                let moved = gaussian[n + k].e_to().mul_add(epsilon[k], z[k] + gaussian[k]);
                z[k] = self.bounds.clamp(k, moved);
            }
            let reward = self.reward(&c.z_u.sample(i)[n..], c.z.sample(i), self.tuple(first + i).z_goal);
            c.target.sample(i)[0] += discount * reward;
        }
    }

    /// Adds the smaller target critic's discounted value of the last code and action to the targets.
    #[inline(always)]
    fn add_values(&self, samples: usize, discount: f32, c: &mut RolloutColumns<'_, f32>) {
        let n = self.agent.latent;
        for i in 0..samples {
            let (state, action) = c.critic_inputs.sample(i).split_at_mut(2 * n);
            state.copy_from_slice(c.inputs.sample(i));
            action.copy_from_slice(&c.z_u.sample(i)[n..]);
        }
        let [target_0, target_1] = &self.agent.targets;
        let net = &self.agent.nets.critic.mlp;
        net.forward(target_0, c.critic_inputs.data, &mut c.critic);
        // Deltas keep the first critic's values while the second critic uses the same buffers.
        let (values, kept) = c.critic.output_and_delta();
        kept.copy_from_slice(values);
        net.forward(target_1, c.critic_inputs.data, &mut c.critic);
        let (values, kept) = c.critic.output_and_delta();
        for i in 0..samples {
            c.target.sample(i)[0] += discount * values[i].min(kept[i]);
        }
    }
}
