//! Constants, terms and batches of the warm-up.

use crate::{lce::terms::loss_terms, nn::binary_images::BinaryImages};

/// Constants of the warm-up loss.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct WarmUp {
    /// Standard deviation of the noise on codes, s. The encoder's own standard deviation is pulled towards it.
    pub sigma: f64,
    /// How far one unit of action (its limit) moves the code.
    pub scale: f64,
    /// Weight of the anchor.
    pub anchor: f64,
    /// Delta of the anchor's pseudo-Huber loss, in units of s: beyond it the loss grows linearly, because a blocked move
    /// is an outlier, not an error of the map.
    pub huber_delta: f64,
    /// Weight of |z|².
    pub shrink: f64,
}

impl Default for WarmUp {
    fn default() -> Self {
        Self { sigma: 0.3, scale: 1.0, anchor: 30.0, huber_delta: 3.0, shrink: 0.01 }
    }
}

loss_terms! {
    /// The terms of the warm-up loss: of one sample, or their means over a batch.
    pub struct WarmUpTerms {
        /// -ln D(x|E(x) + s e).
        encode_decode,
        /// -ln D(x'|F(E(x), u) + s e).
        prediction,
        /// |F(E(x), u) - E(x')|² / 2s².
        consistency,
        /// The anchor.
        anchor,
    }
}

impl WarmUpTerms {
    /// The means over samples.
    pub(super) fn mean<T: crate::num::Real>(samples: &[WarmUpTerms<T>]) -> Self {
        WarmUpTerms::<T>::sum(samples, |term| term / samples.len() as f64)
    }
}

/// One batch of the warm-up.
#[derive(Debug, Clone, Copy)]
pub struct WarmUpBatch<'a, T> {
    /// All images.
    pub images: &'a BinaryImages,
    /// For every sample the numbers of x and x' among the images.
    pub pairs: &'a [u32],
    /// Actions in -1..1, one column each.
    pub actions: &'a [T],
    /// Standard normal noise, two codes for every sample.
    pub noise: &'a [T],
    /// Whether D decodes. Without it only the codes' geometry is learned, several times as fast.
    pub decode: bool,
}
