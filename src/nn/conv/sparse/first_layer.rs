//! The first convolution of images, computed from their lit pixels alone.
//!
//! Lit pixels come in runs, and an output reads a run through neighbouring taps in one row of the filter. The sums of the
//! weights over all 15 runs of neighbouring taps are computed once per training step. An output then adds one such sum per
//! run of lit pixels and filter row. A run of grey pixels has one shade, which is a factor on that sum.

use super::ActiveRows;
use crate::{
    nn::{
        binary_images::BinaryImages,
        conv::{Conv, SIDE},
        mlp::{Layout, Linear},
    },
    num::{Real, simd::vectorize},
};

/// Reach of a filter to either side.
const REACH: usize = SIDE / 2;

/// Number of runs of neighbouring taps in a row of a filter.
const TAP_RUNS: usize = SIDE * (SIDE + 1) / 2;

/// A 5x5 convolution of stride 1 with ReLU on observations, which are stored frame by frame, row by row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct FirstLayer {
    /// The parameters: W \[tap\]\[frame\]\[output\], then b.
    pub(super) weights: Linear,
    frames: usize,
    /// Rows and columns of a frame.
    size: [usize; 2],
}

/// Neighbouring pixels of a row with one shade: the columns from..to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct LitRun {
    /// 1 for lit pixels.
    shade: f64,
    frame: usize,
    row: usize,
    from: usize,
    to: usize,
}

/// The number of the run of taps first..=last.
fn tap_run(first: usize, last: usize) -> usize {
    last * (last + 1) / 2 + first
}

/// sum += factor x. A factor of 1 costs nothing.
#[inline(always)]
fn add<T: Real>(sum: &mut [T], factor: f64, x: &[T]) {
    if factor == 1.0 {
        for (sum, &x) in sum.iter_mut().zip(x) {
            *sum += x;
        }
        return;
    }
    let factor = T::of(factor);
    for (sum, &x) in sum.iter_mut().zip(x) {
        *sum = factor.fma(x, *sum);
    }
}

impl FirstLayer {
    /// A layer on observations of `frames` frames of `size` rows and columns.
    pub(super) fn new(layout: &mut Layout, name: &str, frames: usize, size: [usize; 2], c_out: usize) -> Self {
        let n_in = SIDE * SIDE * frames;
        Self { weights: layout.conv(name, n_in, c_out, n_in), frames, size }
    }

    /// Pixels of an observation.
    pub(super) fn pixels(&self) -> usize {
        self.frames * self.size[0] * self.size[1]
    }

    /// Numbers in the sums of weights over runs of taps: \[filter row\]\[frame\]\[run of taps\]\[output\].
    pub(super) fn tap_sums(&self) -> usize {
        SIDE * self.frames * TAP_RUNS * self.weights.n_out
    }

    /// The index of the sum over a run of taps.
    fn at(&self, filter_row: usize, frame: usize, tap_run: usize) -> usize {
        ((filter_row * self.frames + frame) * TAP_RUNS + tap_run) * self.weights.n_out
    }

    /// Calls `with` for each tap and each sum that contains it: their indices in the weights and in the sums.
    fn each_tap(&self, mut with: impl FnMut(usize, usize)) {
        for (y, frame) in (0..SIDE).flat_map(|y| (0..self.frames).map(move |frame| (y, frame))) {
            for (first, last) in (0..SIDE).flat_map(|last| (0..=last).map(move |first| (first, last))) {
                for x in first..=last {
                    let tap = ((y * SIDE + x) * self.frames + frame) * self.weights.n_out;
                    with(tap, self.at(y, frame, tap_run(first, last)));
                }
            }
        }
    }

    /// Computes the sums of weights over runs of taps; once per training step.
    pub(super) fn pack<T: Real>(&self, arena: &[T], tap_sums: &mut [T]) {
        let (w, c) = (self.weights.w(arena), self.weights.n_out);
        tap_sums.fill(T::ZERO);
        self.each_tap(|tap, at| add(&mut tap_sums[at..at + c], 1.0, &w[tap..tap + c]));
    }

    /// Sets the gradient of the parameters from the gradients of the tap sums, which the gradients of the biases follow.
    pub(super) fn unfold<T: Real>(&self, d_tap_sums: &[T], gradient: &mut [T]) {
        let c = self.weights.n_out;
        let (dw, db) = self.weights.w_b_mut(gradient);
        dw.fill(T::ZERO);
        self.each_tap(|tap, at| add(&mut dw[tap..tap + c], 1.0, &d_tap_sums[at..at + c]));
        db.copy_from_slice(&d_tap_sums[self.tap_sums()..]);
    }

    /// Finds the lit runs of an image.
    pub(super) fn lit_runs(&self, images: &BinaryImages, image: u32, runs: &mut Vec<LitRun>) {
        let [rows, columns] = self.size;
        runs.clear();
        for (pixel, shade) in images.lit(image) {
            let (line, column) = (pixel / columns, pixel % columns);
            let (frame, row) = (line / rows, line % rows);
            match runs.last_mut() {
                Some(run) if (run.frame, run.row, run.to, run.shade) == (frame, row, column, shade) => run.to += 1,
                _ => runs.push(LitRun { shade, frame, row, from: column, to: column + 1 }),
            }
        }
    }

    /// Finds the active pixels of the layer's output.
    pub(super) fn active_rows(&self, runs: &[LitRun], active_rows: &mut ActiveRows) {
        let places = runs.iter().map(|run| (run.row, [run.from, run.to]));
        active_rows.around(places, self.size[1], REACH);
    }

    /// Calls `with` for every output pixel that reads a run: the index of the tap sum that reads it, and the output's row
    /// and column.
    #[inline(always)]
    fn touched(&self, run: LitRun, mut with: impl FnMut(usize, [usize; 2])) {
        let [rows, columns] = self.size;
        for y in 0..SIDE {
            // Output o reads pixel o + tap - 2.
            let Some(row) = (run.row + REACH).checked_sub(y).filter(|&row| row < rows) else { continue };
            for column in run.from.saturating_sub(REACH)..(run.to + REACH).min(columns) {
                let first = (run.from + REACH).saturating_sub(column);
                let last = (run.to - 1 + REACH - column).min(SIDE - 1);
                with(self.at(y, run.frame, tap_run(first, last)), [row, column]);
            }
        }
    }

    /// Writes the outputs for the blank image into the padded input of the next layer.
    pub(super) fn blank<T: Real>(&self, arena: &[T], next: &Conv, y: &mut [T]) {
        let (b, c) = (self.weights.b(arena), self.weights.n_out);
        for r in 0..self.size[0] {
            for y in y[next.input_at(r, 0)..][..self.size[1] * c].chunks_exact_mut(c) {
                y.iter_mut().zip(b).for_each(|(y, b)| *y = b.larger(T::ZERO));
            }
        }
    }

    /// Writes the outputs at an image's active pixels into the padded input of the next layer.
    pub(super) fn forward<T: Real>(
        &self,
        (arena, tap_sums): (&[T], &[T]),
        (runs, active_rows): (&[LitRun], &ActiveRows),
        next: &Conv,
        y: &mut [T],
    ) {
        let (b, c) = (self.weights.b(arena), self.weights.n_out);
        vectorize(
            #[inline(always)]
            || {
                for (r, active) in active_rows.iter() {
                    for y in y[next.input_at(r, active.start)..][..active.len() * c].chunks_exact_mut(c) {
                        y.copy_from_slice(b);
                    }
                }
                for &run in runs {
                    self.touched(
                        run,
                        #[inline(always)]
                        |at, [r, column]| {
                            add(&mut y[next.input_at(r, column)..][..c], run.shade, &tap_sums[at..at + c])
                        },
                    );
                }
                for (r, active) in active_rows.iter() {
                    for y in &mut y[next.input_at(r, active.start)..][..active.len() * c] {
                        *y = y.larger(T::ZERO);
                    }
                }
            },
        );
    }

    /// Adds an image's gradients, from its active pixels, to those of the tap sums and of the biases in `gradient`. `y` is
    /// the output of [`FirstLayer::forward`]. `d_y` is the gradient with respect to it, without border: its sum by channel
    /// is added to `before_relu`, then the ReLU is applied to it here.
    #[allow(clippy::too_many_arguments, reason = "a backward pass names its inputs and where its gradients go")]
    pub(super) fn gradient<T: Real>(
        &self,
        (runs, active_rows): (&[LitRun], &ActiveRows),
        next: &Conv,
        y: &[T],
        d_y: &mut [T],
        gradient: &mut [T],
        before_relu: &mut [T],
    ) {
        let c = self.weights.n_out;
        let (d_tap_sums, db) = gradient.split_at_mut(self.tap_sums());
        let row = self.size[1] * c;
        vectorize(
            #[inline(always)]
            || {
                for (r, active) in active_rows.iter() {
                    let y = &y[next.input_at(r, active.start)..][..active.len() * c];
                    let d_y = &mut d_y[r * row + active.start * c..][..active.len() * c];
                    for (d_y, y) in d_y.chunks_exact_mut(c).zip(y.chunks_exact(c)) {
                        add(before_relu, 1.0, d_y);
                        for (d_y, &y) in d_y.iter_mut().zip(y) {
                            *d_y = if y > T::ZERO { *d_y } else { T::ZERO };
                        }
                        add(db, 1.0, d_y);
                    }
                }
                for &run in runs {
                    self.touched(
                        run,
                        #[inline(always)]
                        |at, [r, column]| {
                            add(&mut d_tap_sums[at..at + c], run.shade, &d_y[r * row + column * c..][..c])
                        },
                    );
                }
            },
        );
    }

    /// Adds the gradient of the biases from all inactive pixels. `d_y` is the sum over all images of the gradients with
    /// respect to the outputs, without border. `active` is the part of it at active pixels, by channel; it is used up.
    pub(super) fn blank_gradient<T: Real>(&self, arena: &[T], d_y: &[T], active: &mut [T], gradient: &mut [T]) {
        let c = self.weights.n_out;
        vectorize(
            #[inline(always)]
            || {
                for d_y in d_y[..self.size[0] * self.size[1] * c].chunks_exact(c) {
                    active.iter_mut().zip(d_y).for_each(|(sum, &d_y)| *sum -= d_y);
                }
            },
        );
        let db = &mut gradient[self.tap_sums()..];
        for ((db, &b), &rest) in db.iter_mut().zip(self.weights.b(arena)).zip(&*active) {
            *db -= if b > T::ZERO { rest } else { T::ZERO };
        }
    }
}
