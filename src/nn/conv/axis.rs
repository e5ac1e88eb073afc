//! One direction, rows or columns, of a convolution's core.

use super::{Resize, SIDE};

/// Taps, stride and padding of the core along one direction.
pub(super) struct Axis {
    pub(super) taps: usize,
    pub(super) stride: usize,
    /// Zeros before the first input.
    pub(super) before: usize,
    pub(super) outputs: usize,
    /// For each true output of a block and each tap of the layer, the tap of the core.
    pub(super) falls: Vec<[usize; SIDE]>,
}

impl Axis {
    /// Axis 0 are rows, axis 1 columns, of an image with `input` of them.
    pub(super) fn new(input: usize, resize: Resize, axis: usize) -> Self {
        match resize {
            Resize::Down(stride) => {
                let falls = vec![std::array::from_fn(|k| k)];
                Self { taps: SIDE, stride, before: SIDE / 2, outputs: input.div_ceil(stride), falls }
            }
            Resize::Up(block) => {
                let block = block[axis];
                // Output a of a block reads the upsampled pixel a + k - 2, which is input pixel ⌊(a + k - 2) / 2⌋.
                let falls: Vec<[usize; SIDE]> = (0..block).map(|a| std::array::from_fn(|k| (a + k) / 2)).collect();
                let stride = block / 2;
                Self { taps: stride + 2, stride, before: 1, outputs: input / stride, falls }
            }
        }
    }

    /// Inputs with padding.
    pub(super) fn padded(&self) -> usize {
        (self.outputs - 1) * self.stride + self.taps
    }

    /// For the inputs ≡ `phase` modulo the stride: each tap that reads them, with the output that it belongs to, relative
    /// to input / stride.
    pub(super) fn reaching(&self, phase: usize) -> impl Iterator<Item = (usize, isize)> + Clone {
        let (stride, shifted) = (self.stride, phase + self.before);
        (0..self.taps)
            .filter(move |t| t % stride == shifted % stride)
            .map(move |t| (t, (shifted as isize - t as isize) / stride as isize))
    }

    /// Zeros needed before and after the outputs' deltas, so that all reads of [`Axis::reaching`] lie inside.
    pub(super) fn delta_margins(&self, input: usize) -> [usize; 2] {
        let reached = |phase: usize| {
            let last = ((input - phase).div_ceil(self.stride) - 1) as isize;
            self.reaching(phase).map(move |(_, o)| (o, last + o))
        };
        let (mut low, mut high) = (0, 0);
        for (first, last) in (0..self.stride.min(input)).flat_map(reached) {
            low = low.min(first);
            high = high.max(last + 1 - self.outputs as isize);
        }
        [low.unsigned_abs(), high.unsigned_abs()]
    }
}
