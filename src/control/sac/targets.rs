//! The critics' targets: r(z') + sum over a latent rollout of gamma^(i+1) (r - alpha ln pi), and the target critics'
//! value at its end where targets bootstrap (paper, equation "SAC Q Update").

use super::{
    super::agent::{Agent, clamp_log_sigma, squash},
    BATCH, Reward, Sac,
};
use crate::{
    lce::LceModel,
    nn::{
        columns::{Block, BlockMut, cut_together, over_samples},
        mlp::{Pass, PassMut},
    },
    num::{Real as _, simd::vectorize},
};

/// Buffers of the latent rollout, and the targets that come of it.
#[derive(Debug)]
pub(super) struct Rollout {
    z: Block<f32>,
    inputs: Block<f32>,
    actor: Pass<f32, 3>,
    z_u: Block<f32>,
    dynamics: Pass<f32, 3>,
    critic_inputs: Block<f32>,
    critic: Pass<f32, 3>,
    /// The critics' target of every sample.
    pub(super) target: Block<f32>,
}

cut_together! {
    struct RolloutMut<'a, T> {
        z: BlockMut<'a, T>,
        inputs: BlockMut<'a, T>,
        actor: PassMut<'a, T, 3>,
        z_u: BlockMut<'a, T>,
        dynamics: PassMut<'a, T, 3>,
        critic_inputs: BlockMut<'a, T>,
        critic: PassMut<'a, T, 3>,
        target: BlockMut<'a, T>,
    }
}

impl Rollout {
    pub(super) fn new(agent: &Agent, model: &LceModel) -> Self {
        let (n, a, b) = (agent.latent, agent.action, BATCH);
        Self {
            z: Block::new(n, b),
            inputs: Block::new(2 * n, b),
            actor: Pass::new(&agent.nets.actor.1, b, 1),
            z_u: Block::new(n + a, b),
            dynamics: Pass::new(&model.nets.dynamics, b, 1),
            critic_inputs: Block::new(2 * n + a, b),
            critic: Pass::new(&agent.nets.critic.1, b, 1),
            target: Block::new(1, b),
        }
    }

    fn view(&mut self) -> RolloutMut<'_, f32> {
        RolloutMut {
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

/// What all samples of a rollout share.
pub(super) struct RollOut<'a> {
    pub(super) agent: &'a Agent,
    pub(super) model: &'a LceModel,
    pub(super) settings: &'a Sac,
    /// Codes stay within these.
    pub(super) low: &'a [f32],
    pub(super) high: &'a [f32],
    /// (z, a, z', z_g) of the batch.
    pub(super) tuples: &'a [f32],
    /// Standard normal noise for every step of the rollout: of the action, then of the code.
    pub(super) noise: &'a [f32],
}

impl RollOut<'_> {
    /// Fills in the targets of the batch.
    pub(super) fn run(&self, threads: usize, buffers: &mut Rollout) {
        let (n, a) = (self.agent.latent, self.agent.action);
        for (z, tuple) in buffers.z.data.chunks_exact_mut(n).zip(self.tuples.chunks_exact(3 * n + a)) {
            z.copy_from_slice(&tuple[n + a..2 * n + a]);
        }
        over_samples(threads, 0, BATCH, buffers.view(), &|first, samples, columns| {
            self.samples(first, samples, columns);
        });
    }

    fn samples(&self, first: usize, samples: usize, mut c: RolloutMut<'_, f32>) {
        vectorize(
            #[inline(always)]
            || self.roll(first, samples, &mut c),
        );
    }

    #[inline(always)]
    fn roll(&self, first: usize, samples: usize, c: &mut RolloutMut<'_, f32>) {
        let (n, a) = (self.agent.latent, self.agent.action);
        let width = 3 * n + a;
        let tuple = |i: usize| &self.tuples[(first + i) * width..][..width];
        let alpha = self.agent.temperature();
        for i in 0..samples {
            c.target.sample(i)[0] = self.settings.reward.of(&tuple(i)[n..n + a], c.z.sample(i), &tuple(i)[2 * n + a..]);
        }
        let mut discount = 1.0_f32;
        let ends = self.settings.rollout + usize::from(self.settings.bootstrap);
        for step in 0..ends {
            discount *= self.settings.discount as f32;
            for i in 0..samples {
                self.agent.input(c.z.sample(i), &tuple(i)[2 * n + a..], c.inputs.sample(i));
            }
            self.agent.nets.actor.1.forward(&self.agent.actor.arena, c.inputs.data, &mut c.actor);
            let step_noise = &self.noise[step * BATCH * (a + n)..][..BATCH * (a + n)];
            for i in 0..samples {
                let epsilon = &step_noise[(first + i) * (a + n)..][..a + n];
                let gaussian = &mut c.actor.out[2][i * 2 * a..][..2 * a];
                clamp_log_sigma(&mut gaussian[a..]);
                let (z, action) = c.z_u.sample(i).split_at_mut(n);
                let log_pi = squash(gaussian, &epsilon[..a], action);
                z.copy_from_slice(c.z.sample(i));
                c.target.sample(i)[0] -= discount * alpha * log_pi;
            }
            if step == self.settings.rollout {
                self.add_values(samples, discount, c);
                return;
            }
            self.model.nets.dynamics.forward(&self.model.arena, c.z_u.data, &mut c.dynamics);
            for i in 0..samples {
                let epsilon = &step_noise[(first + i) * (a + n) + a..][..n];
                let gaussian = &c.dynamics.out[2][i * 2 * n..][..2 * n];
                let z = c.z.sample(i);
                for k in 0..n {
                    let moved = gaussian[n + k].e_to().mul_add(epsilon[k], z[k] + gaussian[k]);
                    z[k] = moved.clamp(self.low[k], self.high[k]);
                }
                let reward = self.settings.reward.of(&c.z_u.sample(i)[n..], c.z.sample(i), &tuple(i)[2 * n + a..]);
                c.target.sample(i)[0] += discount * reward;
            }
        }
    }

    /// Adds the smaller target critic's value of the last state and action.
    fn add_values(&self, samples: usize, discount: f32, c: &mut RolloutMut<'_, f32>) {
        let (n, a) = (self.agent.latent, self.agent.action);
        for i in 0..samples {
            let input = c.critic_inputs.sample(i);
            input[..2 * n].copy_from_slice(c.inputs.sample(i));
            input[2 * n..].copy_from_slice(&c.z_u.sample(i)[n..n + a]);
        }
        let [target_0, target_1] = &self.agent.targets;
        let net = &self.agent.nets.critic.1;
        net.forward(target_0, c.critic_inputs.data, &mut c.critic);
        // The first critic's values wait in the deltas while the second runs in the same buffers.
        let (out, delta) = (&mut c.critic.out[2], &mut c.critic.delta[2]);
        delta[..samples].copy_from_slice(&out[..samples]);
        net.forward(target_1, c.critic_inputs.data, &mut c.critic);
        for i in 0..samples {
            c.target.sample(i)[0] += discount * c.critic.out[2][i].min(c.critic.delta[2][i]);
        }
    }
}

impl Reward {
    /// The reward of reaching z' by an action.
    #[inline(always)]
    pub(in crate::control) fn of(self, action: &[f32], z_next: &[f32], z_goal: &[f32]) -> f32 {
        let squared = z_next.iter().zip(z_goal).map(|(z, g)| (z - g) * (z - g)).sum::<f32>();
        match self {
            Self::Distance => -squared.sqrt(),
            Self::Quadratic => -50.0 * squared - action.iter().map(|u| u * u).sum::<f32>(),
        }
    }
}
