//! One batch of transitions for a loss that needs nothing else: images, actions and noise.

use super::model::LceModel;
use crate::nn::binary_images::BinaryImages;

/// One batch of transitions. It contains no true state.
#[derive(Debug, Clone, Copy)]
pub struct TransitionBatch<'a, T> {
    /// All images.
    pub images: &'a BinaryImages,
    /// For every sample the numbers of x and x' among the images.
    pub pairs: &'a [u32],
    /// For every sample the number of x among the images.
    pub x: &'a [u32],
    /// Actions in -1..1, one column each.
    pub actions: &'a [T],
    /// Standard normal noise, as many numbers for every sample as the loss needs.
    pub noise: &'a [T],
}

/// What all samples of a step share.
pub(super) struct Step<'a, L, T> {
    pub(super) model: &'a LceModel<T>,
    pub(super) loss: &'a L,
    pub(super) batch: &'a TransitionBatch<'a, T>,
    /// 1 over the number of samples.
    pub(super) mean: T,
}

/// Some samples of a step, with the buffers `c` of their networks and terms.
pub(super) struct Pass<'a, L, T, C> {
    pub(super) step: &'a Step<'a, L, T>,
    /// The number of the first sample in the batch.
    pub(super) first: usize,
    pub(super) samples: usize,
    pub(super) c: C,
}

impl<'a, L, T, C> Pass<'a, L, T, C> {
    /// Numbers of a code.
    #[inline(always)]
    pub(super) fn latent(&self) -> usize {
        self.step.model.sizes.latent
    }

    /// The action of a sample.
    #[inline(always)]
    pub(super) fn action(&self, i: usize) -> &'a [T] {
        let a = self.step.model.sizes.action;
        &self.step.batch.actions[(self.first + i) * a..][..a]
    }

    /// The noise of a sample, of so many numbers.
    #[inline(always)]
    pub(super) fn noise_of(&self, i: usize, width: usize) -> &'a [T] {
        &self.step.batch.noise[(self.first + i) * width..][..width]
    }
}
