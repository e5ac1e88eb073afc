//! The anchor E(x') ≈ E(x) + h(E(x)) + p: an action moves the code by the same vector p everywhere, where h are the
//! passive dynamics. The paper has no anchor.
//!
//! p is scale \[u; 0\]. A code of [`SharedFrames`] may hold positions and scaled differences of frames. An action
//! changes only the newest frame of the next observation. So p is scale \[u; 0\] on the positions, and the same vector
//! times the scale of the differences on the differences.

#[cfg(doc)]
use super::shared_frames::SharedFrames;
use super::{
    gaussian_pair::GaussianPair,
    shared_frames::Speeds,
    sizes::{ImageNetworks, Sizes},
};
use crate::num::Real;

/// What one unit of action does to a code, by the kind of networks.
#[derive(Debug, Clone, Copy)]
pub(super) struct Push<T> {
    /// The first coordinates, which are positions.
    positions: usize,
    /// The number of coordinates that the anchor constrains: it leaves mixed differences free.
    anchored: usize,
    /// Scale of the differences.
    difference_scale: T,
}

impl<T: Real> Push<T> {
    /// The push for networks of these sizes.
    pub(super) fn of(sizes: &Sizes) -> Self {
        let n = sizes.latent;
        let (positions, anchored, scale) = match (sizes.speeds(), sizes.images) {
            (Some(Speeds { positions, scale }), _) => (positions, n, scale),
            (None, ImageNetworks::SharedFrames(frames)) => (frames.coordinates, frames.coordinates, 0.0),
            (None, _) => (n, n, 0.0),
        };
        Self { positions, anchored, difference_scale: T::of(scale) }
    }
}

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
    /// Which coordinates the action moves.
    pub(super) push: Push<T>,
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
    /// Component `k` of r = E(x') - E(x) - h - p.
    #[inline(always)]
    fn residual(&self, k: usize) -> T {
        let or_zero = |x: Option<&T>| x.map_or(T::ZERO, |&x| x);
        let (component, scale) = match k.checked_sub(self.push.positions) {
            None => (k, self.scale),
            Some(difference) => (difference, self.scale * self.push.difference_scale),
        };
        let pushed = scale * or_zero(self.action.get(component));
        self.codes.second[k] - self.codes.first[k] - pushed - or_zero(self.h.get(k))
    }

    /// Sets the gradient through h to zero for the coordinates that the anchor leaves free.
    #[inline(always)]
    fn release_the_rest(&mut self) {
        if let Some(rest) = self.d_h.get_mut(self.push.anchored..) {
            rest.fill(T::ZERO);
        }
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
    pub(super) fn squared(&mut self, weight: T) -> T {
        self.release_the_rest();
        let mut sum = T::ZERO;
        for k in 0..self.push.anchored {
            let residual = self.residual(k);
            self.add_gradient(k, weight * (residual + residual));
            sum += residual * residual;
        }
        sum
    }

    /// `strength` delta² (sqrt(1 + |r|²/(s delta)²) - 1), which is `strength` |r|²/2s² for |r| well below s delta; adds
    /// `mean` times its gradient.
    #[inline(always)]
    pub(super) fn pseudo_huber(&mut self, constants: PseudoHuber<T>, strength: T, mean: T) -> T {
        self.release_the_rest();
        let PseudoHuber { inverse_variance, delta_squared } = constants;
        let anchored = self.push.anchored;
        let squared = (0..anchored).map(|k| self.residual(k) * self.residual(k)).fold(T::ZERO, |sum, x| sum + x);
        let root = (T::ONE + squared * inverse_variance / delta_squared).root();
        let slope = mean * strength * inverse_variance / root;
        for k in 0..anchored {
            self.add_gradient(k, slope * self.residual(k));
        }
        strength * delta_squared * (root - T::ONE)
    }
}
