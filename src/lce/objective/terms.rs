//! The terms of the loss, their weights, and their sum.

use crate::lce::terms::loss_terms;

/// What each term of the loss is multiplied by.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Weights {
    /// Of -ln D(x'|z1), the decoder's part of L_p.
    pub reconstruction: f64,
    /// Of KL(B || E(·|x)) - H(E(·|x')) - ln F(z1|z_q, u): all of L_c, and the rest of L_p.
    pub consistency: f64,
    /// Of L_cur.
    pub curvature: f64,
    /// Of L_ed = -ln D(x|z_e).
    pub encode_decode: f64,
    /// Of KL(E(·|x) || N(0, I)). PCC's VAE term has this KL, CARL's L_ed does not.
    pub prior: f64,
    /// Of -ln D(x'|mean F(mean E(x), u)), the "deterministic reconstruction loss".
    pub deterministic: f64,
    /// Of L_reg, see [`Regularizer`](super::Regularizer).
    pub regularizer: f64,
    /// Of the anchor |E(x') - E(x) - h(E(x)) - scale u|², see `warm_up`.
    pub anchor: f64,
}

loss_terms! {
    /// The terms of the loss, without their weights: of one sample, or their means over a batch.
    pub struct Terms {
        /// -ln D(x'|z1).
        reconstruction,
        /// KL(B(·|z1, u, x) || E(·|x)).
        kl_backward,
        /// H(E(·|x')).
        entropy,
        /// ln F(z1|z_q, u).
        log_density,
        /// L_cur.
        curvature,
        /// -ln D(x|z_e).
        encode_decode,
        /// KL(E(·|x) || N(0, I)).
        prior,
        /// -ln D(x'|mean F(mean E(x), u)).
        deterministic,
        /// L_reg.
        regularizer,
        /// The anchor.
        anchor,
    }
}

impl Terms {
    /// The means over samples.
    pub(super) fn mean<T: crate::num::Real>(samples: &[Terms<T>]) -> Self {
        Terms::<T>::sum(samples, |term| term).map(|sum| sum / samples.len() as f64)
    }

    /// The consistency loss L_c = KL(B || E) - H - ln F. The prediction loss L_p is L_c plus the reconstruction.
    pub fn consistency(&self) -> f64 {
        self.kl_backward - self.entropy - self.log_density
    }

    /// The loss: the weighted sum of the terms (paper, equation "CARL-loss").
    pub fn total(&self, weights: &Weights) -> f64 {
        weights.reconstruction * self.reconstruction
            + weights.consistency * self.consistency()
            + weights.curvature * self.curvature
            + weights.encode_decode * self.encode_decode
            + weights.prior * self.prior
            + weights.deterministic * self.deterministic
            + weights.regularizer * self.regularizer
            + weights.anchor * self.anchor
    }
}
