//! KL(N(A mu + B u + o, A S A') || N(mu', S')) in closed form, for A = I + v r' and diagonal S and S'.

use crate::{
    lce::{
        dynamics::{Transition, TransitionGradient},
        gaussian_pair::GaussianPair,
    },
    num::Real,
};

/// The KL of one sample, where `codes` are N(mu, S) and N(mu', S'). Adds `weight` times its gradient to the codes' and to
/// the transition's. `scratch` is a buffer of one code.
///
/// With s and s' the variances, D = v'r, q = sum r² s and m = A mu + B u + o, the KL is half of
/// sum (s (1 + 2 v r) + v² q + (m - mu')²) / s' - n + sum ln s' - sum ln s - 2 ln|1 + D|.
#[inline(always)]
pub(super) fn transition_kl<T: Real>(
    codes: GaussianPair<'_, T>,
    u: &[T],
    transition: Transition<'_, T>,
    weight: T,
    d_transition: &mut TransitionGradient<'_, T>,
    scratch: &mut [T],
) -> T {
    let GaussianPair { first: now, second: next, d_first: d_now, d_second: d_next } = codes;
    let (n, two) = (scratch.len(), T::of(2.0));
    let Transition { v, r, .. } = transition;
    let variance = |k: usize| (now[n + k] + now[n + k]).e_to();
    let precision = |k: usize| (-(next[n + k] + next[n + k])).e_to();
    let sum = |term: &dyn Fn(usize) -> T| (0..n).map(term).fold(T::ZERO, |sum, x| sum + x);
    let determinant = T::ONE + sum(&|k| v[k] * r[k]);
    let q = sum(&|k| r[k] * r[k] * variance(k));
    let p = sum(&|k| v[k] * v[k] * precision(k));
    transition.step(&now[..n], u, scratch);
    let mut twice = -two * determinant.larger(-determinant).log();
    for k in 0..n {
        let (s, inverse) = (variance(k), precision(k));
        let residual = now[k] + scratch[k] - next[k];
        let stretched = s * (T::ONE + two * v[k] * r[k]);
        let ratio = (stretched + v[k] * v[k] * q + residual * residual) * inverse;
        twice += ratio - T::ONE + two * (next[n + k] - now[n + k]);
        let d_mean = weight * residual * inverse;
        scratch[k] = d_mean;
        d_now[k] += d_mean;
        d_next[k] -= d_mean;
        d_now[n + k] += weight * (stretched * inverse + p * r[k] * r[k] * s - T::ONE);
        d_next[n + k] += weight * (T::ONE - ratio);
        d_transition.v[k] += weight * (inverse * (s * r[k] + v[k] * q) - r[k] / determinant);
        d_transition.r[k] += weight * (s * (inverse * v[k] + p * r[k]) - v[k] / determinant);
    }
    transition.step_backward((&now[..n], u), scratch, d_transition, &mut d_now[..n]);
    T::of(0.5) * twice
}
