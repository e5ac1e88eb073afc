//! Constants and terms of PC3's loss.

use crate::lce::terms::loss_terms;

/// Constants of PC3's loss that no other loss has.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Pc3 {
    /// Weight of the contrastive loss NCE.
    pub nce: f64,
    /// Weight of |mean of E(x) over the batch|².
    pub center: f64,
    /// Standard deviation of the noise on E(x').
    pub sigma: f64,
    /// Transitions of a batch. Their pasts are one another's negatives.
    pub batch: u64,
}

impl Default for Pc3 {
    fn default() -> Self {
        Self { nce: 1.0, center: 0.1, sigma: 0.1, batch: 256 }
    }
}

/// PC3's loss at one step: weights of the terms, and constants.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Pc3Loss {
    /// Weight of NCE.
    pub nce: f64,
    /// Weight of the consistency.
    pub consistency: f64,
    /// Weight of L_cur.
    pub curvature: f64,
    /// Weight of |mean of E(x) over the batch|².
    pub center: f64,
    /// Weight of the anchor.
    pub anchor: f64,
    /// Standard deviation of the noise on E(x').
    pub sigma: f64,
    /// Standard deviation of the curvature loss's noise.
    pub curvature_sigma: f64,
    /// How far one unit of action moves the code in the anchor.
    pub anchor_scale: f64,
}

loss_terms! {
    /// The terms of PC3's loss, without their weights: of one sample, or their means over a batch.
    pub struct Pc3Terms {
        /// -ln (F(z'|z, u) / mean of F(z'|·) over the batch's pasts): at least -ln of the number of samples, and 0 where
        /// codes say nothing.
        nce,
        /// -ln F(z'|z, u), with z' = E(x') + noise.
        consistency,
        /// L_cur at (z, u).
        curvature,
        /// |mean of E(x) over the batch|², the same for every sample.
        center,
        /// The anchor.
        anchor,
    }
}

impl Pc3Terms {
    /// The means over samples.
    pub(super) fn mean<T: crate::num::Real>(samples: &[Pc3Terms<T>]) -> Self {
        Pc3Terms::<T>::sum(samples, |term| term).map(|sum| sum / samples.len() as f64)
    }

    /// The loss: the weighted sum of the terms.
    pub fn total(&self, loss: &Pc3Loss) -> f64 {
        loss.nce * self.nce
            + loss.consistency * self.consistency
            + loss.curvature * self.curvature
            + loss.center * self.center
            + loss.anchor * self.anchor
    }
}
