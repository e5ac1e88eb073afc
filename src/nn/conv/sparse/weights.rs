//! What all images of a training step share: packed weights, and the blank image's activations.

use super::{ActiveRows, SparseConvStack};
use crate::{
    nn::conv::{PackedWeights, kernels::correlate},
    num::{Real, simd::vectorize},
};

/// Packed weights of a sparse convolutional stack, and the activations of the blank image.
#[derive(Debug, Clone)]
pub struct SparseConvWeights<T> {
    pub(super) packed: Vec<PackedWeights<T>>,
    /// The first layer's weights, summed over runs of taps.
    pub(super) tap_sums: Vec<T>,
    /// The padded input of each layer for the blank image.
    pub(super) blank_inputs: Vec<Vec<T>>,
    /// The output of each layer for the blank image.
    pub(super) blank_outs: Vec<Vec<T>>,
    /// For each layer, all pixels of its output.
    pub(super) whole: Vec<ActiveRows>,
}

impl<const L: usize> SparseConvStack<L> {
    /// Buffers for the packed weights.
    pub fn packed_weights<T: Real>(&self) -> SparseConvWeights<T> {
        SparseConvWeights {
            packed: self.convs.iter().map(PackedWeights::new).collect(),
            tap_sums: vec![T::ZERO; self.first.tap_sums()],
            blank_inputs: self.convs.iter().map(|conv| vec![T::ZERO; conv.padded_len()]).collect(),
            blank_outs: self.convs.iter().map(|conv| vec![T::ZERO; conv.width()]).collect(),
            whole: self.convs.iter().map(|conv| ActiveRows::whole(conv.core)).collect(),
        }
    }

    /// Packs all weights and runs the blank image; once per training step.
    pub fn pack<T: Real>(&self, arena: &[T], weights: &mut SparseConvWeights<T>) {
        vectorize(
            #[inline(always)]
            || self.convs.iter().zip(&mut weights.packed).for_each(|(conv, packed)| conv.pack(arena, packed)),
        );
        self.first.pack(arena, &mut weights.tap_sums);
        self.first.blank(arena, &self.convs[0], &mut weights.blank_inputs[0]);
        for (l, (conv, packed)) in self.convs.iter().zip(&weights.packed).enumerate() {
            let out = &mut weights.blank_outs[l];
            let input = &weights.blank_inputs[l];
            correlate(&conv.forward, None, &packed.forward, &packed.bias, conv.relu, input, out);
            if let Some(next) = self.convs.get(l + 1) {
                conv.spread(out, next, &mut weights.blank_inputs[l + 1]);
            }
        }
    }
}
