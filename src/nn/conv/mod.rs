//! Convolutions of small images (paper, appendix "Network Architectures"): 5x5 filters, padded by 2, with stride 1 or 2,
//! or after nearest-neighbour upsampling by 2.
//!
//! Upsampling is folded into the weights. Each 2x2 block of an upsampled image repeats one pixel, so the four outputs at
//! such a block are four 3x3 convolutions of the small image with sums of the 5x5 weights. This is exact and takes 9/25
//! of the work. A layer thus computes a plain convolution, its *core*, whose channels are a block of output pixels times
//! the true channels.
//!
//! Images are stored as rows of pixels of channels (NHWC). Channels are filled up with zeros to a multiple of 16.

mod axis;
mod construction;
mod image_layout;
mod kernels;
mod layer;
mod packed_weights;
mod shard_sums;
mod sparse;
mod stack;
#[cfg(test)]
mod tests;

pub use layer::Conv;
pub use packed_weights::PackedWeights;
pub use shard_sums::ShardSums;
pub use sparse::{SparseConvMut, SparseConvPass, SparseConvStack, SparseConvWeights};
pub use stack::{Stack, StackMut, StackPass};

/// Rows and columns of the paper's filters.
const SIDE: usize = 5;

/// How a layer changes the size of an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Resize {
    /// A convolution with this stride.
    Down(usize),
    /// Nearest-neighbour upsampling by 2, then a convolution of stride 1. One output pixel of the core holds a block of
    /// this many rows and columns of true outputs; both are even.
    Up([usize; 2]),
}
