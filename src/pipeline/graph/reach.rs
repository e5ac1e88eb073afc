//! Which axes of the matrix reach which cells. Work that an axis cannot reach is done once for all of its values.
//!
//! The seed and the task reach every stage. The preset reaches the stages whose parameters it changes, and a parameter
//! reaches its own stage. From there an axis reaches every stage downstream. Two things stop it: `[*]`, which takes
//! from all points, and `first`, where it sets the very parameter of the axis.

use super::cells::{Cell, CellId};
use crate::pipeline::{
    resolve::resolved::{Axis, Pipeline, Target},
    syntax::tree::{Key, Table},
};

/// For each cell the axes that reach it, in their order.
pub(super) fn reach(
    cells: &[Cell],
    order: &[CellId],
    pipeline: &Pipeline,
    preset_reaches: &dyn Fn(&Cell) -> bool,
) -> Vec<Vec<usize>> {
    let mut reached: Vec<Vec<usize>> = vec![Vec::new(); cells.len()];
    let mut outside = vec![false; cells.len()];
    for &at in order {
        let cell = &cells[at];
        let mut axes = vec![false; pipeline.axes.len()];
        let mut upstreams = cell.upstream().peekable();
        // A cell that only gathers all points, or takes only from such cells, belongs to no point itself.
        outside[at] = upstreams.peek().is_some();
        for upstream in upstreams {
            outside[at] &= upstream.gathers || outside[upstream.cell];
            if !upstream.gathers {
                reached[upstream.cell].iter().for_each(|axis| axes[*axis] = true);
            }
        }
        for (axis, reaches) in pipeline.axes.iter().zip(&mut axes) {
            *reaches |= !(outside[at] && axis.target.is_global()) && directly(axis, cell, pipeline, preset_reaches);
        }
        reached[at] = (0..axes.len()).filter(|axis| axes[*axis]).collect();
    }
    reached
}

fn directly(axis: &Axis, cell: &Cell, pipeline: &Pipeline, preset_reaches: &dyn Fn(&Cell) -> bool) -> bool {
    let stage = &pipeline.stages[cell.stage];
    match &axis.target {
        Target::Seed | Target::Task(_) => true,
        Target::Preset => preset_reaches(cell),
        Target::Stage { stage, .. } if *stage != cell.stage => false,
        Target::Stage { in_first: true, .. } => stage.is_first(cell.round),
        Target::Stage { path, .. } => {
            !(stage.is_first(cell.round) && stage.first.as_ref().is_some_and(|first| sets(first, path)))
        }
    }
}

/// Whether a `first` table sets the parameter itself, so that the axis changes nothing.
fn sets(first: &Table, path: &[Key]) -> bool {
    first.find(path.iter().map(|key| key.text.as_str())).is_some_and(|found| found.value.as_table().is_none())
}
