//! Convolutions of small images (paper, appendix "Network Architectures"): 5x5, padded by 2, of stride 1 or 2, or
//! after nearest-neighbour upsampling by 2.
//!
//! Upsampling is never carried out. Each 2x2 block of its image repeats one pixel, so the four outputs of such a block
//! are four 3x3 convolutions of the small image with sums of the 5x5 weights: 9/25 of the work, and exact. What a
//! layer computes is then a plain convolution (its *core*) whose channels are a block of pixels times the true channels.
//!
//! Images are rows of pixels of channels; channels are filled up with zeros to a multiple of 16.

mod active_rows;
mod kernels;
mod shard_sums;
mod sparse;
mod sparse_stack;
mod stack;
#[cfg(test)]
mod tests;

pub use shard_sums::ShardSums;
pub use sparse_stack::{SparseConvMut, SparseConvPass, SparseConvStack, SparseConvWeights};
pub use stack::{Stack, StackMut, StackPass};

use active_rows::ActiveRows;
use kernels::{Grid, correlate};

use super::mlp::{Layout, Linear};
use crate::num::Real;

/// Side of the paper's filters.
const SIDE: usize = 5;

/// What a layer does to the size of an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Resize {
    /// Keeps one pixel of each block of so many squared: the stride.
    Down(usize),
    /// Repeats each pixel twice in each direction first; a core pixel gives a block of outputs of this size (rows,
    /// columns), even numbers.
    Up([usize; 2]),
}

/// One convolution with bias, and ReLU where asked.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Conv {
    /// Its parameters: W \[tap\]\[input\]\[output\] as an affine layer from 25 c_in numbers to c_out.
    pub weights: Linear,
    relu: bool,
    /// True channels of the input and of the output.
    channels: [usize; 2],
    input: [usize; 2],
    /// Outputs of the core.
    core: [usize; 2],
    /// True outputs for each output of the core.
    block: [usize; 2],
    stride: usize,
    /// Zeros above and to the left of the input, and its size with all of them.
    before: [usize; 2],
    padded: [usize; 2],
    forward: Grid,
    /// The core's weights as sums of the layer's: (tap of the layer, tap of the core, block).
    folds: Vec<[usize; 3]>,
    /// Zeros above and to the left of the deltas, and their size with all of them.
    delta_before: [usize; 2],
    delta_padded: [usize; 2],
    backward: Vec<Phase>,
}

/// One phase of the stride: the gradients with respect to some rows and columns of the input.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Phase {
    /// The first of them.
    first: [usize; 2],
    grid: Grid,
    /// Which tap of the core each tap of the grid is.
    taps: Vec<usize>,
}

/// One direction of a core: taps, stride, zeros before, and how taps of the layer fall on those of the core.
struct Axis {
    taps: usize,
    stride: usize,
    before: usize,
    outputs: usize,
    /// For each output of a block and each tap of the layer the tap of the core.
    falls: Vec<[usize; SIDE]>,
}

impl Axis {
    fn new(input: usize, resize: Resize, axis: usize) -> Self {
        match resize {
            Resize::Down(stride) => {
                let falls = vec![std::array::from_fn(|k| k)];
                Self { taps: SIDE, stride, before: SIDE / 2, outputs: input.div_ceil(stride), falls }
            }
            Resize::Up(block) => {
                let block = block[axis];
                // Output a of a block reads upsampled pixel a + k - 2, which is small pixel ⌊(a + k - 2) / 2⌋.
                let falls: Vec<[usize; SIDE]> = (0..block).map(|a| std::array::from_fn(|k| (a + k) / 2)).collect();
                let stride = block / 2;
                Self { taps: stride + 2, stride, before: 1, outputs: input / stride, falls }
            }
        }
    }

    fn padded(&self) -> usize {
        (self.outputs - 1) * self.stride + self.taps
    }

    /// For inputs ≡ `phase`: the taps that reach them, and the output that each comes from, relative to input / stride.
    fn reaching(&self, phase: usize) -> impl Iterator<Item = (usize, isize)> + Clone {
        let (stride, shifted) = (self.stride, phase + self.before);
        (0..self.taps)
            .filter(move |t| t % stride == shifted % stride)
            .map(move |t| (t, (shifted as isize - t as isize) / stride as isize))
    }

    /// Zeros before and after the outputs, so that every input finds all outputs it went into.
    fn delta_margins(&self, input: usize) -> [usize; 2] {
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

/// Channels as they lie in memory.
fn filled(channels: usize) -> usize {
    channels.next_multiple_of(16)
}

impl Conv {
    /// A layer on images of `input` rows and columns. `fan_in` bounds its first random weights.
    pub fn new(
        layout: &mut Layout,
        name: impl Into<String>,
        input: [usize; 2],
        channels: [usize; 2],
        resize: Resize,
        relu: bool,
    ) -> Self {
        let [c_in, c_out] = channels;
        // The paper's decoder has transposed convolutions, whose weights start out by the size of their output.
        let fan_in = SIDE * SIDE * if matches!(resize, Resize::Up(_)) { c_out } else { c_in };
        let weights = layout.conv(name, SIDE * SIDE * c_in, c_out, fan_in);
        let [rows, columns] = [0, 1].map(|axis| Axis::new(input[axis], resize, axis));
        let (width_in, width_out) = (filled(c_in), filled(c_out * rows.falls.len() * columns.falls.len()));
        let padded = [rows.padded(), columns.padded()];
        let taps = (0..rows.taps).flat_map(|y| (0..columns.taps).map(move |x| (y * padded[1] + x) * width_in));
        let forward = Grid {
            rows: rows.outputs,
            columns: columns.outputs,
            in_row: rows.stride * padded[1] * width_in,
            in_column: columns.stride * width_in,
            out_row: columns.outputs * width_out,
            out_column: width_out,
            out_start: 0,
            taps: taps.collect(),
            c_in: width_in,
            c_out: width_out,
        };
        let mut folds = Vec::new();
        for (a, y_falls) in rows.falls.iter().enumerate() {
            for (b, x_falls) in columns.falls.iter().enumerate() {
                for (y, x) in (0..SIDE).flat_map(|y| (0..SIDE).map(move |x| (y, x))) {
                    folds.push([y * SIDE + x, y_falls[y] * columns.taps + x_falls[x], a * columns.falls.len() + b]);
                }
            }
        }
        let margins = [rows.delta_margins(input[0]), columns.delta_margins(input[1])];
        let delta_padded =
            [rows.outputs + margins[0][0] + margins[0][1], columns.outputs + margins[1][0] + margins[1][1]];
        let delta_before = [margins[0][0], margins[1][0]];
        let mut backward = Vec::new();
        for (a, b) in (0..rows.stride).flat_map(|a| (0..columns.stride).map(move |b| (a, b))) {
            if a >= input[0] || b >= input[1] {
                continue;
            }
            let (mut places, mut taps) = (Vec::new(), Vec::new());
            for (y, row) in rows.reaching(a) {
                for (x, column) in columns.reaching(b) {
                    let row = (delta_before[0] as isize + row) as usize;
                    let column = (delta_before[1] as isize + column) as usize;
                    places.push((row * delta_padded[1] + column) * width_out);
                    taps.push(y * columns.taps + x);
                }
            }
            let grid = Grid {
                rows: (input[0] - a).div_ceil(rows.stride),
                columns: (input[1] - b).div_ceil(columns.stride),
                in_row: delta_padded[1] * width_out,
                in_column: width_out,
                out_row: rows.stride * input[1] * width_in,
                out_column: columns.stride * width_in,
                out_start: (a * input[1] + b) * width_in,
                taps: places,
                c_in: width_out,
                c_out: width_in,
            };
            backward.push(Phase { first: [a, b], grid, taps });
        }
        Self {
            weights,
            relu,
            channels,
            input,
            core: [rows.outputs, columns.outputs],
            block: [rows.falls.len(), columns.falls.len()],
            stride: rows.stride,
            before: [rows.before, columns.before],
            padded,
            forward,
            folds,
            delta_before,
            delta_padded,
            backward,
        }
    }

    /// Rows and columns of the true output.
    pub fn output(&self) -> [usize; 2] {
        [0, 1].map(|axis| self.core[axis] * self.block[axis])
    }

    /// Numbers that the core puts out for an image.
    pub fn width(&self) -> usize {
        self.core[0] * self.core[1] * self.forward.c_out
    }

    fn padded_len(&self) -> usize {
        // One step more, so that the last pixel too begins a whole one.
        self.padded[0] * self.padded[1] * self.forward.c_in + self.forward.in_column
    }

    fn delta_padded_len(&self) -> usize {
        self.delta_padded[0] * self.delta_padded[1] * self.forward.c_out
    }

    fn input_len(&self) -> usize {
        self.input[0] * self.input[1] * self.forward.c_in
    }

    /// The core's weights and biases from those of the layer; once a step.
    fn pack<T: Real>(&self, arena: &[T], kernels: &mut PackedWeights<T>) {
        let (w, b, [c_in, c_out]) = (self.weights.w(arena), self.weights.b(arena), self.channels);
        kernels.forward.fill(T::ZERO);
        for &[tap, core, block] in &self.folds {
            for i in 0..c_in {
                let at = self.forward.at(core, i, block * c_out);
                let w = &w[(tap * c_in + i) * c_out..][..c_out];
                // A block of outputs never straddles two runs of packed weights.
                for (sum, &w) in kernels.forward[at..at + c_out].iter_mut().zip(w) {
                    *sum += w;
                }
            }
        }
        for block in kernels.bias.chunks_exact_mut(c_out).take(self.block[0] * self.block[1]) {
            block.copy_from_slice(b);
        }
        for (Phase { grid, taps, .. }, packed) in self.backward.iter().zip(&mut kernels.backward) {
            for (tap, &core) in taps.iter().enumerate() {
                for o in 0..grid.c_in {
                    for i in 0..grid.c_out {
                        packed[grid.at(tap, o, i)] = kernels.forward[self.forward.at(core, i, o)];
                    }
                }
            }
        }
    }

    /// The gradient of the layer's parameters from that of the core's weights and from the sum of its deltas.
    fn unfold<T: Real>(&self, d_core: &[T], d_bias: &[T], gradient: &mut [T]) {
        let [c_in, c_out] = self.channels;
        let (dw, db) = self.weights.w_b_mut(gradient);
        dw.fill(T::ZERO);
        for &[tap, core, block] in &self.folds {
            for i in 0..c_in {
                let at = self.forward.at(core, i, block * c_out);
                for (sum, &d) in dw[(tap * c_in + i) * c_out..][..c_out].iter_mut().zip(&d_core[at..]) {
                    *sum += d;
                }
            }
        }
        db.fill(T::ZERO);
        for block in d_bias.chunks_exact(c_out).take(self.block[0] * self.block[1]) {
            for (sum, &d) in db.iter_mut().zip(block) {
                *sum += d;
            }
        }
    }

    /// Numbers of the true output.
    pub fn pixels(&self) -> usize {
        let [rows, columns] = self.output();
        rows * columns * self.channels[1]
    }

    /// The true output, pixel by pixel, from what the core put out.
    pub fn flatten<T: Copy>(&self, out: &[T], flat: &mut [T]) {
        self.runs(self.output()[1] * self.channels[1], |core, at, len| {
            flat[at..at + len].copy_from_slice(&out[core..core + len]);
        });
    }

    /// The way back of [`Conv::flatten`], for deltas.
    pub fn unflatten<T: Copy>(&self, d_flat: &[T], delta: &mut [T]) {
        self.runs(self.output()[1] * self.channels[1], |core, at, len| {
            delta[core..core + len].copy_from_slice(&d_flat[at..at + len]);
        });
    }

    /// The true output, channel by channel: the frames of an observation.
    pub fn to_frames<T: Copy>(&self, out: &[T], frames: &mut [T]) {
        self.frames(|core, at| frames[at] = out[core]);
    }

    /// The way back of [`Conv::to_frames`], for deltas.
    pub fn from_frames<T: Copy>(&self, frames: &[T], delta: &mut [T]) {
        self.frames(|core, at| delta[core] = frames[at]);
    }

    fn frames(&self, mut copy: impl FnMut(usize, usize)) {
        let (c, size) = (self.channels[1], self.pixels() / self.channels[1]);
        self.runs(self.output()[1] * c, |core, at, len| {
            for (channel, pixel) in (0..c).flat_map(|channel| (0..len / c).map(move |pixel| (channel, pixel))) {
                copy(core + pixel * c + channel, channel * size + at / c + pixel);
            }
        });
    }

    /// Writes one of the images `flat`, pixel by pixel, into the padded input.
    pub fn fill<T: Copy>(&self, flat: &[T], image: usize, input: &mut [T]) {
        let ([rows, columns], c) = (self.input, self.channels[0]);
        let flat = &flat[image * rows * columns * c..][..rows * columns * c];
        for (pixel, channels) in flat.chunks_exact(c).enumerate() {
            let at = self.input_at(pixel / columns, pixel % columns);
            input[at..at + c].copy_from_slice(channels);
        }
    }

    /// The gradient with respect to one of the images, as they lie in [`Conv::fill`], from that without borders.
    pub fn take<T: Copy>(&self, d_input: &[T], d_flat: &mut [T], image: usize) {
        let ([rows, columns], c) = (self.input, self.channels[0]);
        let d_flat = &mut d_flat[image * rows * columns * c..][..rows * columns * c];
        for (d_flat, d) in d_flat.chunks_exact_mut(c).zip(d_input.chunks_exact(self.forward.c_in)) {
            d_flat.copy_from_slice(&d[..c]);
        }
    }

    /// Where a pixel lies in the padded input.
    fn input_at(&self, row: usize, column: usize) -> usize {
        ((row + self.before[0]) * self.padded[1] + column + self.before[1]) * self.forward.c_in
    }

    /// Where an output of the core lies.
    fn output_at(&self, row: usize, column: usize) -> usize {
        row * self.forward.out_row + column * self.forward.out_column
    }

    /// Where an output of the core lies in the padded deltas.
    fn delta_at(&self, row: usize, column: usize) -> usize {
        ((row + self.delta_before[0]) * self.delta_padded[1] + column + self.delta_before[1]) * self.forward.c_out
    }

    /// The padded deltas from the first output of the core on, and the length of a row.
    fn deltas<'a, T>(&self, padded: &'a [T]) -> (&'a [T], usize) {
        (&padded[self.delta_at(0, 0)..], self.delta_padded[1] * self.forward.c_out)
    }

    /// The gradient with respect to the layer's input, without borders, from padded deltas; within `active_rows`, where they are
    /// given, for which `runs` is room.
    fn d_input<T: Real>(
        &self,
        kernels: &PackedWeights<T>,
        padded: &[T],
        mut within: Option<(&ActiveRows, &mut Vec<[usize; 2]>)>,
        d_input: &mut [T],
    ) {
        for (Phase { first, grid, .. }, w) in self.backward.iter().zip(&kernels.backward) {
            let runs = within.as_mut().map(|(active_rows, runs)| {
                active_rows.phase(*first, self.stride, runs);
                &runs[..]
            });
            correlate(grid, runs, w, &kernels.zeros, false, padded, d_input);
        }
    }

    /// Calls `copy` with every run of pixels that lie side by side both in the core's outputs and in the image they
    /// make, `row` numbers to a row: where it begins in either, and its length in numbers.
    fn runs(&self, row: usize, mut copy: impl FnMut(usize, usize, usize)) {
        let ([rows, columns], [bh, bw], c) = (self.core, self.block, self.channels[1]);
        for (r, a) in (0..rows).flat_map(|r| (0..bh).map(move |a| (r, a))) {
            for column in 0..columns {
                let core = (r * columns + column) * self.forward.c_out + a * bw * c;
                copy(core, (r * bh + a) * row + column * bw * c, bw * c);
            }
        }
    }
}

/// The weights of a layer as its loops read them.
#[derive(Debug, Clone)]
pub struct PackedWeights<T> {
    forward: Vec<T>,
    bias: Vec<T>,
    backward: Vec<Vec<T>>,
    /// What the way back starts from.
    zeros: Vec<T>,
}

impl<T: Real> PackedWeights<T> {
    fn new(conv: &Conv) -> Self {
        Self {
            forward: vec![T::ZERO; conv.forward.weights()],
            bias: vec![T::ZERO; conv.forward.c_out],
            zeros: vec![T::ZERO; conv.forward.c_in],
            backward: conv.backward.iter().map(|phase| vec![T::ZERO; phase.grid.weights()]).collect(),
        }
    }
}
