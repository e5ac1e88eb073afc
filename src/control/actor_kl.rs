//! KL of an actor's Gaussians to fixed ones: the core of policy distillation and of L_reg.

use super::agent::{clamp_log_sigma, log_sigma_is_free};
use crate::num::Real as _;

/// How sigma² / sigma_0² is computed from the log standard deviations. The two ways differ in rounding only; each loss
/// keeps its own, so that its results keep their bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum VarianceRatio {
    /// exp(2 ln sigma) exp(-2 ln sigma_0).
    Product,
    /// exp(2 (ln sigma - ln sigma_0)).
    Difference,
}

/// KL(N(mu, sigma²) || N(mu_0, sigma_0²)) of one actor output to a `fixed` Gaussian. The KL of Gaussians before tanh is
/// that of the squashed policies.
///
/// Clamps the actor's log standard deviations, sets `delta` to `weight` times the gradient, and calls `component` with
/// the KL of every action component.
#[inline(always)]
pub(super) fn actor_kl(
    gaussian: &mut [f32],
    fixed: &[f32],
    ratio: VarianceRatio,
    weight: f32,
    delta: &mut [f32],
    mut component: impl FnMut(f32),
) {
    let a = fixed.len() / 2;
    for k in 0..a {
        let free = log_sigma_is_free(gaussian[a + k]);
        clamp_log_sigma(&mut gaussian[a + k..=a + k]);
        let (mu, log_sigma) = (gaussian[k], gaussian[a + k]);
        let (mu_0, log_sigma_0) = (fixed[k], fixed[a + k]);
        let inverse = (-2.0 * log_sigma_0).e_to();
        let difference = mu - mu_0;
        let ratio = match ratio {
            VarianceRatio::Product => (2.0 * log_sigma).e_to() * inverse,
            VarianceRatio::Difference => (2.0 * (log_sigma - log_sigma_0)).e_to(),
        };
        component(log_sigma_0 - log_sigma + 0.5 * (ratio + difference * difference * inverse) - 0.5);
        delta[k] = weight * difference * inverse;
        delta[a + k] = if free { weight * (ratio - 1.0) } else { 0.0 };
    }
}
