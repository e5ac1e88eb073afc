//! ln N(z'; A mu + B u + o, A S A') for A = I + v r' and diagonal S.

use crate::{
    lce::dynamics::{Transition, TransitionGradient},
    nn::heads::HALF_LN_TAU,
    num::Real,
};

/// A point z' and the Gaussian N(mu, S) before the transition (means, then log standard deviations).
pub(super) struct Moved<'a, T> {
    pub(super) next: &'a [T],
    pub(super) gaussian: &'a [T],
    pub(super) u: &'a [T],
}

/// The log density. Adds `weight` times its gradient to those of z', of the Gaussian and of the transition. `scratch` is a
/// buffer of two codes.
///
/// With w = z' - (A mu + B u + o) and D = v'r, A⁻¹ w = w - v (r'w) / (1 + D) (Sherman and Morrison), and ln|A| = ln|1 + D|.
#[inline(always)]
pub(super) fn log_density<T: Real>(
    Moved { next, gaussian, u }: Moved<'_, T>,
    transition: Transition<'_, T>,
    weight: T,
    (d_next, d_gaussian): (&mut [T], &mut [T]),
    d_transition: &mut TransitionGradient<'_, T>,
    scratch: &mut [T],
) -> T {
    let n = next.len();
    let Transition { v, r, .. } = transition;
    let (w, slopes) = scratch.split_at_mut(n);
    let sum = |term: &dyn Fn(usize) -> T| (0..n).map(term).fold(T::ZERO, |sum, x| sum + x);
    transition.step(&gaussian[..n], u, w);
    for k in 0..n {
        w[k] = next[k] - gaussian[k] - w[k];
    }
    let determinant = T::ONE + sum(&|k| v[k] * r[k]);
    let along = sum(&|k| r[k] * w[k]) / determinant;
    let mut value = -determinant.larger(-determinant).log();
    // S⁻¹ A⁻¹ w
    for k in 0..n {
        let back = v[k].fma(-along, w[k]);
        let log_sigma = gaussian[n + k];
        slopes[k] = back * (-(log_sigma + log_sigma)).e_to();
        let squared = back * slopes[k];
        value -= T::of(0.5) * squared + log_sigma + T::of(HALF_LN_TAU);
        d_gaussian[n + k] += weight * (squared - T::ONE);
    }
    let across = sum(&|k| v[k] * slopes[k]) / determinant;
    for k in 0..n {
        d_transition.v[k] += weight * (along * slopes[k] - (along * across + T::ONE / determinant) * r[k]);
        d_transition.r[k] += weight * (across * w[k] - (along * across + T::ONE / determinant) * v[k]);
        // The gradient with respect to A mu + B u + o.
        slopes[k] = weight * r[k].fma(-across, slopes[k]);
        d_next[k] -= slopes[k];
        d_gaussian[k] += slopes[k];
    }
    transition.step_backward((&gaussian[..n], u), slopes, d_transition, &mut d_gaussian[..n]);
    value
}
