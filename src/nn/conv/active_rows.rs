//! Where the layers of an image can differ from those of the blank image.

use std::ops::Range;

use super::{Conv, SIDE};

/// In every row of a layer's output one run of pixels, outside of which it is that of the blank image. Empty runs begin
/// behind their end.
#[derive(Debug, Clone)]
pub(super) struct ActiveRows(Vec<[usize; 2]>);

const EMPTY: [usize; 2] = [usize::MAX, 0];

/// The smallest run that holds both.
fn hull(a: [usize; 2], b: [usize; 2]) -> [usize; 2] {
    [a[0].min(b[0]), a[1].max(b[1])]
}

impl ActiveRows {
    /// Nothing differs yet.
    pub(super) fn new(rows: usize) -> Self {
        Self(vec![EMPTY; rows])
    }

    /// All pixels.
    pub(super) fn whole([rows, columns]: [usize; 2]) -> Self {
        Self(vec![[0, columns]; rows])
    }

    /// Of a convolution of stride 1 whose filters reach `reach` pixels to either side, from runs of lit pixels in rows.
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

    /// Of the outputs of `conv` that read a pixel of `input`.
    pub(super) fn after(&mut self, conv: &Conv, input: &Self) {
        let [stride, columns] = [conv.stride, conv.core[1]];
        let rows = self.0.iter_mut().enumerate();
        for (row, active) in rows {
            let first = (row * stride).saturating_sub(conv.before[0]);
            let end = (row * stride + SIDE - conv.before[0]).min(conv.input[0]);
            let [from, to] = input.0[first..end].iter().fold(EMPTY, |a, &b| hull(a, b));
            *active = EMPTY;
            if from < to {
                // Output o reads the pixels from o stride - before on, SIDE of them.
                let low = (from + conv.before[1]).saturating_sub(SIDE - 1).div_ceil(stride);
                *active = [low, ((to - 1 + conv.before[1]) / stride + 1).min(columns)];
            }
        }
    }

    /// Of every `stride`-th row and column, from `first` on, into `runs`.
    pub(super) fn phase(&self, first: [usize; 2], stride: usize, runs: &mut Vec<[usize; 2]>) {
        let below = |pixel: usize| pixel.saturating_sub(first[1]).div_ceil(stride);
        runs.clear();
        runs.extend(
            self.0.iter().skip(first[0]).step_by(stride).map(
                |&[from, to]| {
                    if from < to { [below(from), below(to)] } else { EMPTY }
                },
            ),
        );
    }

    /// The runs by row.
    pub(super) fn runs(&self) -> &[[usize; 2]] {
        &self.0
    }

    /// Rows that are not empty, with their pixels.
    pub(super) fn iter(&self) -> impl Iterator<Item = (usize, Range<usize>)> + '_ {
        self.0.iter().enumerate().filter(|(_, [from, to])| from < to).map(|(row, &[from, to])| (row, from..to))
    }
}
