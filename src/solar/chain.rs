//! The structured posterior over a trajectory, q(z_1:T): exact inference in a chain of Gaussian potentials and expected
//! linear-Gaussian dynamics, by an information filter and a backward pass.
//!
//! q is proportional to N(z_1; 0, I) Π exp(E ln N(z_t+1; F y_t, Σ)) Π ψ_t(z_t). With W = -2 e1, U = e2 and G = -2 e3 of the
//! dynamics, its joint precision is block tridiagonal: J_t + \[t = 1\] I + \[t > 1\] W + \[t < T\] G_zz on the diagonal and -U_z
//! below it.

mod gradient;
mod steps;

use steps::Steps;

use super::{
    MOST_ACTION, MOST_LATENT,
    mniw::{Expected, Natural},
};

/// The potentials of a trajectory: the diagonals of J and h for every step, d numbers each.
#[derive(Debug, Clone, Copy)]
pub struct Evidence<'a> {
    /// The diagonals of J_1, …, J_T.
    pub precision: &'a [f64],
    /// h_1, …, h_T.
    pub linear: &'a [f64],
}

/// A gradient with respect to the potentials of a trajectory.
#[derive(Debug)]
pub struct EvidenceGradient<'a> {
    /// With respect to the diagonals of J, with h held fixed.
    pub precision: &'a mut [f64],
    /// With respect to h, with J held fixed.
    pub linear: &'a mut [f64],
}

/// Inference for one trajectory after another. It keeps its buffers, so that it allocates nothing. Numbers are not finite
/// where a precision is not positive definite.
pub trait Chain: std::fmt::Debug + Send {
    /// Sets E t of the dynamics: one for every transition, or one for all of them.
    fn set_dynamics(&mut self, dynamics: &[Expected]);

    /// Computes q for a trajectory whose `actions` have m components a step; the last action has no influence. Returns
    /// ln Z.
    fn smooth(&mut self, evidence: Evidence<'_>, actions: &[f64]) -> f64;

    /// Smoothed means, d numbers a step.
    fn means(&self) -> &[f64];

    /// Smoothed covariances, d x d numbers a step.
    fn covariances(&self) -> &[f64];

    /// Cov(z_t+1, z_t) for t = 1, …, T-1, d x d numbers each.
    fn cross_covariances(&self) -> &[f64];

    /// KL(q || p(z | actions)) = Σ (hᵀm - ½ tr J (S + m mᵀ)) - ln Z.
    fn kl(&self) -> f64;

    /// Adds `weight` times the gradient of [`Chain::kl`]. The gradient is the Hessian of ln Z times (J, h): the derivative of
    /// the smoothed moments in that direction, which one more pass computes.
    fn kl_gradient(&mut self, weight: f64, gradient: EvidenceGradient<'_>);

    /// Draws z_1:T from q, backwards in time, from standard normal `noise` of d numbers a step.
    fn sample(&mut self, noise: &[f64]) -> &[f64];

    /// Adds the gradient of <d_sample, sample> for the last sample, in reverse through the sampling and the filter.
    fn sample_gradient(&mut self, d_sample: &[f64], gradient: EvidenceGradient<'_>);

    /// Adds the expected statistics of every transition, times `strength`, to `statistics`: to one for each transition, or
    /// all to one. An action counts as a Gaussian of this variance.
    fn add_statistics(&self, actions: &[f64], strength: f64, action_variance: f64, statistics: &mut [Natural]);
}

/// Inference for trajectories of up to `steps` steps, with d latent and m action components.
///
/// # Panics
/// If d or m is 0 or larger than [`MOST_LATENT`] and [`MOST_ACTION`].
pub fn chain(d: usize, m: usize, steps: usize) -> Box<dyn Chain> {
    assert!((1..=MOST_ACTION).contains(&m), "actions of {m} components");
    match d {
        1 => Box::new(Steps::<1>::new(m, steps)),
        2 => Box::new(Steps::<2>::new(m, steps)),
        3 => Box::new(Steps::<3>::new(m, steps)),
        4 => Box::new(Steps::<4>::new(m, steps)),
        5 => Box::new(Steps::<5>::new(m, steps)),
        6 => Box::new(Steps::<6>::new(m, steps)),
        7 => Box::new(Steps::<7>::new(m, steps)),
        8 => Box::new(Steps::<8>::new(m, steps)),
        _ => panic!("latent states of {d} components; the most are {MOST_LATENT}"),
    }
}
