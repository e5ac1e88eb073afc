//! Tables of series: a grid of rows and columns, and its text in several formats.

mod cells;
mod formats;
mod grid;
mod long;

pub use cells::{Rows, short};
pub use formats::{csv, json};
pub use grid::{Cell, Grid, UnknownField, field};
pub use long::long;

/// What a table shows: a metric, and the fields that rows and columns stand for.
#[derive(Debug, Clone, Copy)]
pub struct About<'a> {
    /// The metric.
    pub metric: &'a str,
    /// The field of the rows, such as `task`.
    pub rows: &'a str,
    /// The field of the columns, such as `algorithm`.
    pub cols: &'a str,
}

impl About<'_> {
    /// Whether the metric is the share of time at the goal, for which ceilings and the paper's numbers are known.
    fn is_percent_goal(&self) -> bool {
        self.metric == "percent_goal"
    }
}
