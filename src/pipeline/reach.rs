//! Which axes of the matrix reach which cells: what an axis cannot reach is made once for all of its values.
//!
//! The seed and the task reach every stage, the preset those whose parameters it changes, and a parameter its own
//! stage; from there an axis reaches all that takes from it. Two things stop it: `[*]`, which takes from all points,
//! and `first`, where it sets the very parameter of the axis.

use super::{
    draft::{Axis, Draft, Target},
    tree::{Key, find},
    unroll::{Cell, CellId},
};

/// For each cell the axes that reach it, in their order.
pub(super) fn reach(
    cells: &[Cell],
    order: &[CellId],
    draft: &Draft<'_>,
    preset_reaches: &dyn Fn(&Cell) -> bool,
) -> Vec<Vec<usize>> {
    let mut reached: Vec<Vec<usize>> = vec![Vec::new(); cells.len()];
    let mut outside = vec![false; cells.len()];
    for &at in order {
        let cell = &cells[at];
        let mut axes = vec![false; draft.axes.len()];
        let mut givers = cell.givers().peekable();
        // What only gathers all points, and what only takes from such, belongs to no point itself.
        outside[at] = givers.peek().is_some();
        for giver in givers {
            outside[at] &= giver.gathers || outside[giver.cell];
            if !giver.gathers {
                reached[giver.cell].iter().for_each(|axis| axes[*axis] = true);
            }
        }
        for (axis, reaches) in draft.axes.iter().zip(&mut axes) {
            *reaches |= !(outside[at] && axis.target.is_global()) && directly(axis, cell, draft, preset_reaches);
        }
        reached[at] = (0..axes.len()).filter(|axis| axes[*axis]).collect();
    }
    reached
}

fn directly(axis: &Axis<'_>, cell: &Cell, draft: &Draft<'_>, preset_reaches: &dyn Fn(&Cell) -> bool) -> bool {
    match &axis.target {
        Target::Seed | Target::Task(_) => true,
        Target::Preset => preset_reaches(cell),
        Target::Stage { stage, .. } if *stage != cell.stage => false,
        Target::Stage { in_first: true, .. } => {
            let stage = &draft.stages[cell.stage];
            cell.round.is_some() && cell.round == stage.from
        }
        Target::Stage { path, .. } => {
            let stage = &draft.stages[cell.stage];
            !(cell.is_first(stage) && stage.first.as_ref().is_some_and(|first| sets(first, path)))
        }
    }
}

/// Whether a `first` table sets the parameter itself, so that the axis changes nothing.
fn sets(first: &toml::de::DeTable<'_>, path: &[Key<'_>]) -> bool {
    let words: Vec<&str> = path.iter().map(|key| key.get_ref().as_ref()).collect();
    find(first, &words).is_some_and(|found| !found.get_ref().is_table())
}
