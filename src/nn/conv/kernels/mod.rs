//! The two loops of a convolution, over images stored as rows of pixels of channels, with their border of zeros.
//!
//! Every number is one chain of fused multiply-adds, over taps and then inputs, or over pixels. So neither the size of a
//! tile nor the instruction set changes a bit.

mod accumulate;
mod correlate;

pub(super) use accumulate::accumulate;
pub(super) use correlate::correlate;

/// Where a correlation reads and writes. Distances and indices are counted in numbers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Grid {
    /// Rows of outputs.
    pub(super) rows: usize,
    /// Columns of outputs.
    pub(super) columns: usize,
    /// Distance in the input between neighbouring rows of outputs.
    pub(super) in_row: usize,
    /// Distance in the input between neighbouring columns of outputs.
    pub(super) in_column: usize,
    /// Distance in the output between neighbouring rows.
    pub(super) out_row: usize,
    /// Distance in the output between neighbouring columns.
    pub(super) out_column: usize,
    /// Index of the first output.
    pub(super) out_start: usize,
    /// For each tap, the index of the input pixel that it reads for the first output.
    pub(super) taps: Vec<usize>,
    /// Channels read, a multiple of 16.
    pub(super) c_in: usize,
    /// Channels written, a multiple of 16.
    pub(super) c_out: usize,
}

impl Grid {
    /// Channels that one tile writes. Their weights are neighbours.
    #[inline]
    fn block(&self) -> usize {
        if self.c_out.is_multiple_of(32) { 32 } else { 16 }
    }

    /// Number of packed weights.
    pub(super) fn weights(&self) -> usize {
        self.taps.len() * self.c_in * self.c_out
    }

    /// The index of a weight in the packed weights \[block of outputs\]\[tap\]\[input\]\[output in block\].
    #[inline]
    pub(super) fn at(&self, tap: usize, input: usize, output: usize) -> usize {
        let b = self.block();
        ((output / b * self.taps.len() + tap) * self.c_in + input) * b + output % b
    }
}

/// For every row, the pixels from..to. The run is empty where `from` is not below `to`.
pub(super) type Runs<'a> = &'a [[usize; 2]];

/// The run of a row; all of its pixels without `runs`.
#[inline(always)]
fn run(grid: &Grid, runs: Option<Runs<'_>>, row: usize) -> [usize; 2] {
    runs.map_or([0, grid.columns], |runs| runs[row])
}
