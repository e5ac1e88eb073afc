//! Time-varying linear-Gaussian policies, a ~ N(K_t z + k_t, S_t).

use super::Small;

/// One step of a policy.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PolicyStep {
    /// K \[m, d\].
    pub gain: Small,
    /// k, a column of m.
    pub offset: Small,
    /// S \[m, m\], the covariance of the action.
    pub covariance: Small,
}

/// A policy for every step of an episode.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LinearGaussianPolicy {
    /// The steps.
    pub steps: Vec<PolicyStep>,
}

impl LinearGaussianPolicy {
    /// Actions that ignore the state: N(0, std² I), where `std` has one entry for each of the m components.
    pub fn random(steps: usize, d: usize, std: &[f64]) -> Self {
        let m = std.len();
        let covariance = Small::from_fn(m, m, |i, j| if i == j { std[i] * std[i] } else { 0.0 });
        let step = PolicyStep { gain: Small::zeros(m, d), offset: Small::zeros(m, 1), covariance };
        Self { steps: vec![step; steps] }
    }

    /// The action of step `t` at a latent state, with standard normal noise or without. After the last step, the last
    /// one counts.
    pub fn action(&self, t: usize, z: &Small, noise: Option<&Small>) -> Small {
        let PolicyStep { gain, offset, covariance } = &self.steps[t.min(self.steps.len() - 1)];
        let mean = gain.times(z).plus(1.0, offset);
        match noise.and_then(|noise| Some(covariance.cholesky()?.times(noise))) {
            Some(noise) => mean.plus(1.0, &noise),
            None => mean,
        }
    }
}
