//! Weights and terms of E2C's loss.

use crate::lce::terms::loss_terms;

/// E2C's loss at one step: weights of the terms, and constants.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct E2cLoss {
    /// Weight of -ln D(x|z).
    pub encode_decode: f64,
    /// Weight of -ln D(x'|A z + B u + o).
    pub prediction: f64,
    /// Weight of KL(E(·|x) || N(0, I)).
    pub prior: f64,
    /// Weight of the transition's KL, lambda.
    pub transition_kl: f64,
    /// Weight of the anchor.
    pub anchor: f64,
    /// How far one unit of action moves the code in the anchor.
    pub anchor_scale: f64,
}

loss_terms! {
    /// The terms of E2C's loss, without their weights: of one sample, or their means over a batch.
    pub struct E2cTerms {
        /// -ln D(x|z), z ~ E(·|x).
        encode_decode,
        /// -ln D(x'|A z + B u + o).
        prediction,
        /// KL(E(·|x) || N(0, I)).
        prior,
        /// KL(N(A mu + B u + o, A S A') || E(·|x')), where E(·|x) = N(mu, S).
        transition_kl,
        /// The anchor.
        anchor,
    }
}

impl E2cTerms {
    /// The means over samples.
    pub(super) fn mean<T: crate::num::Real>(samples: &[E2cTerms<T>]) -> Self {
        E2cTerms::<T>::sum(samples, |term| term).map(|sum| sum / samples.len() as f64)
    }

    /// The loss: the weighted sum of the terms.
    pub fn total(&self, loss: &E2cLoss) -> f64 {
        loss.encode_decode * self.encode_decode
            + loss.prediction * self.prediction
            + loss.prior * self.prior
            + loss.transition_kl * self.transition_kl
            + loss.anchor * self.anchor
    }
}
