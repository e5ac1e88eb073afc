//! The first convolution of binary images, by their lit pixels alone: a few per cent of them.
//!
//! SparseConv pixels come in runs, and an output reads a run through neighbouring taps of a row of the filter. So what it adds is
//! one of 15 sums of such taps, made once a step.

use super::{Conv, SIDE, active_rows::ActiveRows};
use crate::{
    nn::{
        binary_images::BinaryImages,
        mlp::{Layout, Linear},
    },
    num::{Real, simd::vectorize},
};

/// Reach of a filter to either side.
const REACH: usize = SIDE / 2;

/// Runs of neighbouring taps in a row of a filter.
const TAP_RUNS: usize = SIDE * (SIDE + 1) / 2;

/// A 5x5 convolution of stride 1 with ReLU on observations, which lie frame by frame, row by row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct SparseConv {
    /// Its parameters: W \[tap\]\[frame\]\[output\].
    pub(super) weights: Linear,
    frames: usize,
    size: [usize; 2],
}

/// SparseConv pixels side by side: frame, row, and the columns from..to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Run {
    frame: usize,
    row: usize,
    from: usize,
    to: usize,
}

/// The number of the run of taps first..=last.
fn tap_run(first: usize, last: usize) -> usize {
    last * (last + 1) / 2 + first
}

/// sum += x.
#[inline(always)]
fn add<T: Real>(sum: &mut [T], x: &[T]) {
    for (sum, &x) in sum.iter_mut().zip(x) {
        *sum += x;
    }
}

impl SparseConv {
    /// A layer on observations of so many frames of `size` rows and columns.
    pub(super) fn new(layout: &mut Layout, name: &str, frames: usize, size: [usize; 2], c_out: usize) -> Self {
        let n_in = SIDE * SIDE * frames;
        Self { weights: layout.conv(name, n_in, c_out, n_in), frames, size }
    }

    /// Pixels of an observation.
    pub(super) fn pixels(&self) -> usize {
        self.frames * self.size[0] * self.size[1]
    }

    /// Numbers in sums of weights over runs of taps: \[row of taps\]\[frame\]\[run of taps\]\[output\].
    pub(super) fn run_weights(&self) -> usize {
        SIDE * self.frames * TAP_RUNS * self.weights.n_out
    }

    /// Where such a sum lies.
    fn at(&self, tap_row: usize, frame: usize, tap_run: usize) -> usize {
        ((tap_row * self.frames + frame) * TAP_RUNS + tap_run) * self.weights.n_out
    }

    /// Calls `with` with each tap, where it lies in the weights, and each sum that it is part of.
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

    /// The weights summed over runs of taps; once a step.
    pub(super) fn pack<T: Real>(&self, arena: &[T], sums: &mut [T]) {
        let (w, c) = (self.weights.w(arena), self.weights.n_out);
        sums.fill(T::ZERO);
        self.each_tap(|tap, at| add(&mut sums[at..at + c], &w[tap..tap + c]));
    }

    /// Sets the gradient of the parameters from that of the sums over runs of taps, then of the biases.
    pub(super) fn unfold<T: Real>(&self, d_sums: &[T], gradient: &mut [T]) {
        let c = self.weights.n_out;
        let (dw, db) = self.weights.w_b_mut(gradient);
        dw.fill(T::ZERO);
        self.each_tap(|tap, at| add(&mut dw[tap..tap + c], &d_sums[at..at + c]));
        db.copy_from_slice(&d_sums[self.run_weights()..]);
    }

    /// The lit pixels of an image.
    pub(super) fn runs(&self, images: &BinaryImages, image: u32, runs: &mut Vec<Run>) {
        let [rows, columns] = self.size;
        runs.clear();
        for (pixel, _) in images.lit(image) {
            let (line, column) = (pixel / columns, pixel % columns);
            let (frame, row) = (line / rows, line % rows);
            match runs.last_mut() {
                Some(run) if (run.frame, run.row, run.to) == (frame, row, column) => run.to += 1,
                _ => runs.push(Run { frame, row, from: column, to: column + 1 }),
            }
        }
    }

    /// Where the outputs differ from those of the blank image.
    pub(super) fn active_rows(&self, runs: &[Run], active_rows: &mut ActiveRows) {
        let places = runs.iter().map(|run| (run.row, [run.from, run.to]));
        active_rows.around(places, self.size[1], REACH);
    }

    /// Every output pixel that a run has a part in, and the sum of taps that reads the run.
    #[inline(always)]
    fn touched(&self, run: Run, mut with: impl FnMut(usize, [usize; 2])) {
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

    /// The outputs for the blank image, into the padded input of the next layer.
    pub(super) fn blank<T: Real>(&self, arena: &[T], next: &Conv, y: &mut [T]) {
        let (b, c) = (self.weights.b(arena), self.weights.n_out);
        for r in 0..self.size[0] {
            for y in y[next.input_at(r, 0)..][..self.size[1] * c].chunks_exact_mut(c) {
                y.iter_mut().zip(b).for_each(|(y, b)| *y = b.larger(T::ZERO));
            }
        }
    }

    /// The outputs of an image's active_rows, into the padded input of the next layer. `sums` are the weights over runs of taps.
    pub(super) fn forward<T: Real>(
        &self,
        (arena, sums): (&[T], &[T]),
        (runs, active_rows): (&[Run], &ActiveRows),
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
                        |at, [r, column]| add(&mut y[next.input_at(r, column)..][..c], &sums[at..at + c]),
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

    /// Adds the gradients of sums over runs of taps, then of biases, for an image's active_rows. `y` is what [`SparseConv::forward`]
    /// put out; `d_y`, the gradient with respect to it without borders, is masked here and summed into `before` first.
    #[allow(clippy::too_many_arguments, reason = "a way back names what went forth and where its gradients go")]
    pub(super) fn gradient<T: Real>(
        &self,
        (runs, active_rows): (&[Run], &ActiveRows),
        next: &Conv,
        y: &[T],
        d_y: &mut [T],
        gradient: &mut [T],
        before: &mut [T],
    ) {
        let c = self.weights.n_out;
        let (d_sums, db) = gradient.split_at_mut(self.run_weights());
        let row = self.size[1] * c;
        vectorize(
            #[inline(always)]
            || {
                for (r, active) in active_rows.iter() {
                    let y = &y[next.input_at(r, active.start)..][..active.len() * c];
                    let d_y = &mut d_y[r * row + active.start * c..][..active.len() * c];
                    for (d_y, y) in d_y.chunks_exact_mut(c).zip(y.chunks_exact(c)) {
                        add(before, d_y);
                        for (d_y, &y) in d_y.iter_mut().zip(y) {
                            *d_y = if y > T::ZERO { *d_y } else { T::ZERO };
                        }
                        add(db, d_y);
                    }
                }
                for &run in runs {
                    self.touched(
                        run,
                        #[inline(always)]
                        |at, [r, column]| add(&mut d_sums[at..at + c], &d_y[r * row + column * c..][..c]),
                    );
                }
            },
        );
    }

    /// Adds the gradient of the biases for the blank image. `d_y` is the sum of the gradients with respect to the
    /// outputs of all images, without borders; `in_spans` what of it lay in their active_rows, and is used up.
    pub(super) fn blank_gradient<T: Real>(&self, arena: &[T], d_y: &[T], in_spans: &mut [T], gradient: &mut [T]) {
        let c = self.weights.n_out;
        vectorize(
            #[inline(always)]
            || {
                for d_y in d_y[..self.size[0] * self.size[1] * c].chunks_exact(c) {
                    in_spans.iter_mut().zip(d_y).for_each(|(sum, &d_y)| *sum -= d_y);
                }
            },
        );
        let db = &mut gradient[self.run_weights()..];
        for ((db, &b), &rest) in db.iter_mut().zip(self.weights.b(arena)).zip(&*in_spans) {
            *db -= if b > T::ZERO { rest } else { T::ZERO };
        }
    }
}
