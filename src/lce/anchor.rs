//! The anchor E(x') ≈ E(x) + h(E(x)) + scale \[u; 0\]: an action moves the code by the same vector everywhere, where h are
//! the passive dynamics. The paper has no anchor.

use super::gaussian_pair::GaussianPair;
use crate::num::Real;

/// The anchor of one sample.
pub(super) struct Anchor<'a, T> {
    /// E(·|x) and E(·|x').
    pub(super) codes: GaussianPair<'a, T>,
    /// h(E(x)), empty without passive dynamics.
    pub(super) h: &'a [T],
    /// The gradient with respect to h, to fill in.
    pub(super) d_h: &'a mut [T],
    /// The action, in -1..1.
    pub(super) action: &'a [T],
    /// How far one unit of action moves the code.
    pub(super) scale: T,
}

/// Constants of the pseudo-Huber loss.
#[derive(Debug, Clone, Copy)]
pub(super) struct PseudoHuber<T> {
    /// 1 / s², where s is the unit of distance.
    pub(super) inverse_variance: T,
    /// delta², where beyond a distance of delta (in units of s) the loss grows linearly.
    pub(super) delta_squared: T,
}

impl<T: Real> Anchor<'_, T> {
    /// Component `k` of r = E(x') - E(x) - h - scale \[u; 0\].
    #[inline(always)]
    fn residual(&self, k: usize) -> T {
        let or_zero = |x: Option<&T>| x.map_or(T::ZERO, |&x| x);
        self.codes.second[k] - self.codes.first[k] - self.scale * or_zero(self.action.get(k)) - or_zero(self.h.get(k))
    }

    /// Adds the gradient with respect to a residual to both codes, and sets h's.
    #[inline(always)]
    fn add_gradient(&mut self, k: usize, slope: T) {
        self.codes.d_second[k] += slope;
        self.codes.d_first[k] -= slope;
        if let Some(d_h) = self.d_h.get_mut(k) {
            *d_h = -slope;
        }
    }

    /// |r|²; adds `weight` times its gradient.
    #[inline(always)]
    pub(super) fn squared(&mut self, latent: usize, weight: T) -> T {
        let mut sum = T::ZERO;
        for k in 0..latent {
            let residual = self.residual(k);
            self.add_gradient(k, weight * (residual + residual));
            sum += residual * residual;
        }
        sum
    }

    /// `strength` delta² (sqrt(1 + |r|²/(s delta)²) - 1), which is `strength` |r|²/2s² for |r| well below s delta; adds
    /// `mean` times its gradient.
    #[inline(always)]
    pub(super) fn pseudo_huber(&mut self, latent: usize, constants: PseudoHuber<T>, strength: T, mean: T) -> T {
        let PseudoHuber { inverse_variance, delta_squared } = constants;
        let squared = (0..latent).map(|k| self.residual(k) * self.residual(k)).fold(T::ZERO, |sum, x| sum + x);
        let root = (T::ONE + squared * inverse_variance / delta_squared).root();
        let slope = mean * strength * inverse_variance / root;
        for k in 0..latent {
            self.add_gradient(k, slope * self.residual(k));
        }
        strength * delta_squared * (root - T::ONE)
    }
}
