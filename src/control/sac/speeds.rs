//! What latent rollouts and rewards do with the speeds of codes that hold them (see [`Speeds`]).
//!
//! A speed is a difference of two frames, with the noise of both. The speed of the next step shares one of them, with the
//! other sign. So an F that is fitted to such codes by least squares shrinks speeds (regression dilution): it has a
//! friction that the task does not have, and an agent that trains long in F leaves the damping of a swing to it.

use crate::{
    lce::{LceModel, Speeds},
    num::{rng::Rng, sampling},
};

/// Antifriction in latent rollouts: every step adds c v to the speeds v, and their share to the positions.
#[derive(Debug)]
pub(super) struct Antifriction {
    speeds: Speeds,
    most: f32,
    /// c for each speed of each sample of the batch, kept over a rollout.
    factors: Vec<f32>,
}

impl Antifriction {
    /// Factors up to `most` for a batch of `samples`; `None` where there are none, or codes hold no speeds.
    pub(super) fn new(model: &LceModel, most: f64, samples: usize) -> Option<Self> {
        let speeds = model.sizes.speeds().filter(|_| most > 0.0)?;
        Some(Self { speeds, most: most as f32, factors: vec![0.0; speeds.positions * samples] })
    }

    /// Draws new factors for all samples, uniformly.
    pub(super) fn draw(&mut self, rng: &mut Rng) {
        let most = self.most;
        self.factors.fill_with(|| sampling::uniform(rng, 0.0, most));
    }

    /// Adds the antifriction of one step of sample `sample` from code `z` to the step's mean `moved`.
    #[inline(always)]
    pub(super) fn push(&self, sample: usize, z: &[f32], moved: &mut [f32]) {
        let Speeds { positions: m, scale } = self.speeds;
        let share = 1.0 / scale as f32;
        for (k, factor) in self.factors[sample * m..][..m].iter().enumerate() {
            let gained = factor * z[m + k];
            moved[m + k] += gained;
            moved[k] = share.mul_add(gained, moved[k]);
        }
    }
}

/// Factors on the coordinates of z - z_g in the reward: `weight` on speeds, and one factor on all that keeps the mean
/// squared distance of the codes to the goals. All are 1 where codes hold no speeds.
pub(super) fn distance_factors(model: &LceModel, weight: f64, gaussians: &[f32], goals: &[f32]) -> Vec<f32> {
    let n = model.sizes.latent;
    let Some(Speeds { positions, .. }) = model.sizes.speeds().filter(|_| weight != 1.0) else { return vec![1.0; n] };
    let (mut before, mut after) = (0.0, 0.0);
    for (code, goal) in gaussians.chunks_exact(2 * n).flat_map(|code| goals.chunks_exact(n).map(move |g| (code, g))) {
        for k in 0..n {
            let squared = f64::from(code[k] - goal[k]).powi(2);
            before += squared;
            after += squared * if k < positions { 1.0 } else { weight * weight };
        }
    }
    let all = (before / after).sqrt();
    (0..n).map(|k| (all * if k < positions { 1.0 } else { weight }) as f32).collect()
}
