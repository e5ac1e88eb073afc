//! One convolutional layer: its shape and where its numbers lie.

use super::kernels::Grid;
use crate::nn::mlp::Linear;

/// A convolution with bias, followed by a ReLU if asked for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Conv {
    /// The parameters, stored as an affine layer from 25 c_in numbers to c_out: W \[tap\]\[input\]\[output\], then b.
    pub weights: Linear,
    pub(super) relu: bool,
    /// True channels of the input and of the output.
    pub(super) channels: [usize; 2],
    /// Rows and columns of the input.
    pub(super) input: [usize; 2],
    /// Rows and columns of the core's output.
    pub(super) core: [usize; 2],
    /// Rows and columns of true outputs in one output pixel of the core.
    pub(super) block: [usize; 2],
    pub(super) stride: usize,
    pub(super) padded_input: Padding,
    /// The core, forward.
    pub(super) forward: Grid,
    pub(super) folds: Vec<Fold>,
    pub(super) padded_deltas: Padding,
    /// The core's transpose, by phase of the stride.
    pub(super) backward: Vec<Phase>,
}

/// A border of zeros around an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Padding {
    /// Rows of zeros above, columns of zeros to the left.
    pub(super) before: [usize; 2],
    /// Rows and columns of the image with its border.
    pub(super) size: [usize; 2],
}

impl Padding {
    /// The index of an image's pixel in the padded image.
    #[inline]
    fn at(&self, row: usize, column: usize) -> usize {
        (row + self.before[0]) * self.size[1] + column + self.before[1]
    }

    /// Pixels of the padded image.
    fn pixels(&self) -> usize {
        self.size[0] * self.size[1]
    }
}

/// One summand of the core's weights: the layer's weights at tap `tap` are added to the core's at `core_tap`, for the
/// outputs of `block`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Fold {
    pub(super) tap: usize,
    pub(super) core_tap: usize,
    pub(super) block: usize,
}

/// One phase of the stride: the gradients with respect to every `stride`-th row and column of the input.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Phase {
    /// The first row and column.
    pub(super) first: [usize; 2],
    pub(super) grid: Grid,
    /// For every tap of the grid, the tap of the core.
    pub(super) taps: Vec<usize>,
}

impl Conv {
    /// Rows and columns of the true output.
    pub fn output(&self) -> [usize; 2] {
        [0, 1].map(|axis| self.core[axis] * self.block[axis])
    }

    /// Numbers in the true output of an image.
    pub fn pixels(&self) -> usize {
        let [rows, columns] = self.output();
        rows * columns * self.channels[1]
    }

    /// Numbers in the core's output for an image.
    pub fn width(&self) -> usize {
        self.core[0] * self.core[1] * self.forward.c_out
    }

    /// Numbers in the padded input.
    pub(super) fn padded_len(&self) -> usize {
        // One step more than the image, because kernels read whole steps from the last pixel too.
        self.padded_input.pixels() * self.forward.c_in + self.forward.in_column
    }

    /// Numbers in the padded deltas.
    pub(super) fn delta_padded_len(&self) -> usize {
        self.padded_deltas.pixels() * self.forward.c_out
    }

    /// Numbers in the input without its border.
    pub(super) fn input_len(&self) -> usize {
        self.input[0] * self.input[1] * self.forward.c_in
    }

    /// The index of a pixel in the padded input.
    #[inline]
    pub(super) fn input_at(&self, row: usize, column: usize) -> usize {
        self.padded_input.at(row, column) * self.forward.c_in
    }

    /// The index of a pixel in the core's output.
    #[inline]
    pub(super) fn output_at(&self, row: usize, column: usize) -> usize {
        row * self.forward.out_row + column * self.forward.out_column
    }

    /// The index of an output pixel of the core in the padded deltas.
    #[inline]
    pub(super) fn delta_at(&self, row: usize, column: usize) -> usize {
        self.padded_deltas.at(row, column) * self.forward.c_out
    }

    /// The padded deltas from the core's first output on, and the length of their rows.
    pub(super) fn deltas<'a, T>(&self, padded: &'a [T]) -> (&'a [T], usize) {
        (&padded[self.delta_at(0, 0)..], self.padded_deltas.size[1] * self.forward.c_out)
    }
}
