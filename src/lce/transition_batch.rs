//! One batch of transitions for a loss that needs nothing else: images, actions and noise.

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
