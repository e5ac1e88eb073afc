//! Speeds in latent rollouts and rewards, for codes that hold speeds (see [`Speeds`]).
//!
//! A speed is a difference of two frames, with the noise of both. The speed of the next step shares one of these
//! frames, with the other sign. An F that is fitted to such codes by least squares therefore shrinks speeds (regression
//! dilution): F has a friction that the task does not have. An agent that trains long in F relies on this friction to
//! damp its swings.

use crate::{
    lce::{LceModel, Speeds},
    num::{rng::Rng, sampling},
};

/// Antifriction in latent rollouts: every step adds c v to the speeds v, and c v / scale to the positions.
#[derive(Debug)]
pub(super) struct Antifriction {
    speeds: Speeds,
    /// The largest c.
    most: f32,
    /// c for each speed of each sample of the batch. A rollout keeps its factors.
    pub(super) factors: Vec<f32>,
}

impl Antifriction {
    /// Antifriction with factors up to `most` for a batch of `samples`; `None` if `most` is 0 or codes hold no speeds.
    pub(super) fn new(model: &LceModel, most: f64, samples: usize) -> Option<Self> {
        let speeds = model.sizes.speeds().filter(|_| most > 0.0)?;
        Some(Self { speeds, most: most as f32, factors: vec![0.0; speeds.positions * samples] })
    }

    /// Draws new factors for all samples, uniformly.
    pub(super) fn draw(&mut self, rng: &mut Rng) {
        let most = self.most;
        self.factors.fill_with(|| sampling::uniform(rng, 0.0, most));
    }

    /// Adds the antifriction of one step to `moved`, the mean move that F predicts for sample `sample` from code `z`.
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

/// Factors on the coordinates of z - z_g in the reward. Speeds are weighted by `weight`. A common factor on all
/// coordinates keeps the mean squared distance of the codes to the goals. All factors are 1 if codes hold no speeds.
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
