//! Weights and terms of RCE's loss.

use crate::lce::terms::loss_terms;

/// RCE's loss at one step: weights of the terms, and constants. With all weights 1 it is minus the bound.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RceLoss {
    /// Weight of -ln D(x'|z').
    pub reconstruction: f64,
    /// Weight of KL(B || E(·|x)) - H(E(·|x')) - ln N(z'; A mu + B u + o, A S A').
    pub consistency: f64,
    /// Weight of the anchor.
    pub anchor: f64,
    /// How far one unit of action moves the code in the anchor.
    pub anchor_scale: f64,
}

loss_terms! {
    /// The terms of RCE's loss, without their weights: of one sample, or their means over a batch.
    pub struct RceTerms {
        /// -ln D(x'|z'), z' ~ E(·|x').
        reconstruction,
        /// KL(B(·|z', u, x) || E(·|x)).
        kl_backward,
        /// H(E(·|x')).
        entropy,
        /// ln N(z'; A mu + B u + o, A S A'), with the transition at a sample of B, where E(·|x) = N(mu, S).
        log_density,
        /// The anchor.
        anchor,
    }
}

impl RceTerms {
    /// The means over samples.
    pub(super) fn mean<T: crate::num::Real>(samples: &[RceTerms<T>]) -> Self {
        RceTerms::<T>::sum(samples, |term| term).map(|sum| sum / samples.len() as f64)
    }

    /// KL - H - ln N.
    pub fn consistency(&self) -> f64 {
        self.kl_backward - self.entropy - self.log_density
    }

    /// The loss: the weighted sum of the terms.
    pub fn total(&self, loss: &RceLoss) -> f64 {
        loss.reconstruction * self.reconstruction + loss.consistency * self.consistency() + loss.anchor * self.anchor
    }
}
