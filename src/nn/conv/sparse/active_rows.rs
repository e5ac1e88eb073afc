//! The pixels at which a layer's output can differ from its output for the blank image.

use std::ops::Range;

use crate::nn::conv::{Conv, SIDE};

/// One run of active pixels, from..to, in every row of a layer's output. Outside of the runs the output is that of the
/// blank image. An empty run has `from` ≥ `to`.
#[derive(Debug, Clone)]
pub(in crate::nn::conv) struct ActiveRows(Vec<[usize; 2]>);

const EMPTY: [usize; 2] = [usize::MAX, 0];

/// The smallest run that contains both.
fn hull(a: [usize; 2], b: [usize; 2]) -> [usize; 2] {
    [a[0].min(b[0]), a[1].max(b[1])]
}

impl ActiveRows {
    /// Empty runs.
    pub(super) fn new(rows: usize) -> Self {
        Self(vec![EMPTY; rows])
    }

    /// All pixels of an image.
    pub(super) fn whole([rows, columns]: [usize; 2]) -> Self {
        Self(vec![[0, columns]; rows])
    }

    /// Sets the active pixels of a convolution of stride 1 whose filters reach `reach` pixels to either side. `runs` are
    /// runs of lit pixels, each with its row; the image has `columns` columns.
    pub(super) fn around(&mut self, runs: impl Iterator<Item = (usize, [usize; 2])>, columns: usize, reach: usize) {
        self.0.fill(EMPTY);
        let rows = self.0.len();
        for (row, [from, to]) in runs {
            let run = [from.saturating_sub(reach), (to + reach).min(columns)];
            for active in &mut self.0[row.saturating_sub(reach)..(row + reach + 1).min(rows)] {
                *active = hull(*active, run);
            }
        }
    }

    /// Sets the active pixels of the output of `conv`: those that read an active pixel of its `input`.
    pub(super) fn after(&mut self, conv: &Conv, input: &Self) {
        let ([rows_before, columns_before], stride) = (conv.padded_input.before, conv.stride);
        for (row, active) in self.0.iter_mut().enumerate() {
            let first = (row * stride).saturating_sub(rows_before);
            let end = (row * stride + SIDE - rows_before).min(conv.input[0]);
            let [from, to] = input.0[first..end].iter().fold(EMPTY, |a, &b| hull(a, b));
            *active = EMPTY;
            if from < to {
                // Output o reads SIDE pixels from o stride - before on.
                let low = (from + columns_before).saturating_sub(SIDE - 1).div_ceil(stride);
                *active = [low, ((to - 1 + columns_before) / stride + 1).min(conv.core[1])];
            }
        }
    }

    /// Writes the runs of one phase, every `stride`-th row and column from `first` on, into `runs`.
    pub(in crate::nn::conv) fn phase(&self, first: [usize; 2], stride: usize, runs: &mut Vec<[usize; 2]>) {
        let below = |pixel: usize| pixel.saturating_sub(first[1]).div_ceil(stride);
        let of_phase = |&[from, to]: &[usize; 2]| if from < to { [below(from), below(to)] } else { EMPTY };
        runs.clear();
        runs.extend(self.0.iter().skip(first[0]).step_by(stride).map(of_phase));
    }

    /// The runs of all rows.
    pub(super) fn runs(&self) -> &[[usize; 2]] {
        &self.0
    }

    /// The rows with active pixels, and these pixels.
    pub(super) fn iter(&self) -> impl Iterator<Item = (usize, Range<usize>)> + '_ {
        self.0.iter().enumerate().filter(|(_, [from, to])| from < to).map(|(row, &[from, to])| (row, from..to))
    }
}
