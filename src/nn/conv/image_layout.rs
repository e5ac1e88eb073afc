//! Copies between images and the buffers of a layer.

use super::Conv;
use crate::num::{Real, simd::vectorize};

impl Conv {
    /// Copies the core's output into the true output, pixel by pixel.
    pub fn flatten<T: Copy>(&self, out: &[T], flat: &mut [T]) {
        self.runs(self.output()[1] * self.channels[1], |core, at, len| {
            flat[at..at + len].copy_from_slice(&out[core..core + len]);
        });
    }

    /// The inverse of [`Conv::flatten`], for deltas.
    pub fn unflatten<T: Copy>(&self, d_flat: &[T], delta: &mut [T]) {
        self.runs(self.output()[1] * self.channels[1], |core, at, len| {
            delta[core..core + len].copy_from_slice(&d_flat[at..at + len]);
        });
    }

    /// Copies the core's output into the true output, channel by channel, like the frames of an observation.
    pub fn to_frames<T: Copy>(&self, out: &[T], frames: &mut [T]) {
        self.frames(|core, at| frames[at] = out[core]);
    }

    /// The inverse of [`Conv::to_frames`], for deltas.
    pub fn from_frames<T: Copy>(&self, frames: &[T], delta: &mut [T]) {
        self.frames(|core, at| delta[core] = frames[at]);
    }

    /// Calls `copy` with every number's index in the core's output and in the frames.
    fn frames(&self, mut copy: impl FnMut(usize, usize)) {
        let (c, size) = (self.channels[1], self.pixels() / self.channels[1]);
        self.runs(self.output()[1] * c, |core, at, len| {
            for (channel, pixel) in (0..c).flat_map(|channel| (0..len / c).map(move |pixel| (channel, pixel))) {
                copy(core + pixel * c + channel, channel * size + at / c + pixel);
            }
        });
    }

    /// Copies image `image` of `flat`, stored pixel by pixel, into the padded input.
    pub fn fill<T: Copy>(&self, flat: &[T], image: usize, input: &mut [T]) {
        let ([rows, columns], c) = (self.input, self.channels[0]);
        let flat = &flat[image * rows * columns * c..][..rows * columns * c];
        for (pixel, channels) in flat.chunks_exact(c).enumerate() {
            let at = self.input_at(pixel / columns, pixel % columns);
            input[at..at + c].copy_from_slice(channels);
        }
    }

    /// Copies the gradient with respect to the input, without border, into image `image` of `d_flat`, which is stored
    /// like the images of [`Conv::fill`].
    pub fn take<T: Copy>(&self, d_input: &[T], d_flat: &mut [T], image: usize) {
        let ([rows, columns], c) = (self.input, self.channels[0]);
        let d_flat = &mut d_flat[image * rows * columns * c..][..rows * columns * c];
        for (d_flat, d) in d_flat.chunks_exact_mut(c).zip(d_input.chunks_exact(self.forward.c_in)) {
            d_flat.copy_from_slice(&d[..c]);
        }
    }

    /// Copies the core's output into the padded input of the next layer.
    pub(super) fn spread<T: Real>(&self, out: &[T], next: &Self, input: &mut [T]) {
        let origin = next.input_at(0, 0);
        self.runs(next.padded_input.size[1] * next.forward.c_in, |core, at, len| {
            input[origin + at..][..len].copy_from_slice(&out[core..core + len]);
        });
    }

    /// Computes the core's deltas from the gradient with respect to the true output, which has `channels` channels
    /// filled up. The ReLU passes no gradient where its output is 0.
    pub(super) fn gather<T: Real>(&self, d_output: &[T], channels: usize, out: &[T], delta: &mut [T]) {
        vectorize(
            #[inline(always)]
            || {
                self.runs(self.output()[1] * channels, |core, at, len| {
                    let d = &d_output[at..at + len];
                    for ((delta, &out), &d) in delta[core..core + len].iter_mut().zip(&out[core..core + len]).zip(d) {
                        *delta = if out > T::ZERO { d } else { T::ZERO };
                    }
                });
            },
        );
    }

    /// Copies deltas into the padded buffer. Its border stays zero.
    pub(super) fn pad<T: Copy>(&self, delta: &[T], padded: &mut [T]) {
        let row = self.core[1] * self.forward.c_out;
        for (r, delta) in delta.chunks_exact(row).enumerate() {
            padded[self.delta_at(r, 0)..][..row].copy_from_slice(delta);
        }
    }

    /// Calls `copy` with every run of numbers that are neighbours both in the core's output and in the true output:
    /// the run's start in either, and its length. A row of the true output has `row` numbers.
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
