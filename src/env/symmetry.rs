//! Exact symmetries of a task, as operations on the pictures and the action of a transition. They read no state.

use std::ops::Range;

use super::Frames;
use crate::num::rng::Rng;

/// A change of transitions under which the dynamics stay the same: a changed transition is again a transition of the
/// task, up to the rounding of pixels. `tests/it/science/symmetries.rs` checks this for every built-in task.
#[derive(Debug, Clone, Copy)]
pub struct Symmetry {
    /// The name that pipeline files write.
    pub name: &'static str,
    /// One line that says what changes.
    pub about: &'static str,
    /// Changes a transition. Random choices come from the stream.
    pub apply: fn(&mut SeenTransition<'_>, &mut Rng),
}

/// A transition (x, u, x') as training sees it.
#[derive(Debug)]
pub struct SeenTransition<'a> {
    /// The frames of x and after them those of x'. A byte is a pixel, 0 or 255, row by row.
    pub pictures: &'a mut [u8],
    /// The action, each component in -1..1.
    pub action: &'a mut [f32],
    /// The frames of one observation.
    pub frames: Frames,
}

impl SeenTransition<'_> {
    /// Reverses the columns of every frame.
    pub fn mirror_columns(&mut self) {
        self.pictures.chunks_exact_mut(self.frames.width).for_each(<[u8]>::reverse);
    }

    /// Moves every frame by a number of columns, to the right where it is positive. Columns that enter are dark.
    pub fn shift_columns(&mut self, columns: isize) {
        let by = columns.unsigned_abs().min(self.frames.width);
        for row in self.pictures.chunks_exact_mut(self.frames.width) {
            let kept = row.len() - by;
            if columns > 0 {
                row.copy_within(..kept, by);
                row[..by].fill(0);
            } else {
                row.copy_within(by.., 0);
                row[kept..].fill(0);
            }
        }
    }

    /// Changes the sign of every component of the action.
    pub fn reverse_action(&mut self) {
        self.action.iter_mut().for_each(|u| *u = -*u);
    }

    /// The first and the last column with a lit pixel in these rows of any frame; `None` where all are dark.
    pub fn lit_columns(&self, rows: Range<usize>) -> Option<(usize, usize)> {
        let width = self.frames.width;
        let bands = self.pictures.chunks_exact(self.frames.pixels());
        let rows = bands.flat_map(|frame| frame[rows.start * width..rows.end * width].chunks_exact(width));
        let ends = rows.filter_map(|row| {
            let is_lit = |&pixel: &u8| pixel != 0;
            Some((row.iter().position(is_lit)?, row.iter().rposition(is_lit)?))
        });
        ends.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))
    }
}
