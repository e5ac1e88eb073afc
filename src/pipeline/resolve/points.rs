//! Points of the matrix.

use super::resolved::{Axis, Target};
use crate::pipeline::limits::MAX_NODES;

/// For each axis the index of its value, or `None` for what the file says without that axis.
pub(crate) type Point = Vec<Option<usize>>;

/// Whether an axis can change the parameters of a stage. Presets may depend on the task, so the task can.
pub(crate) fn reaches_params(axis: &Axis, at: usize) -> bool {
    match &axis.target {
        Target::Seed => false,
        Target::Preset | Target::Task(_) => true,
        Target::Stage { stage, .. } => *stage == at,
    }
}

/// All points over the axes that count. The list is empty where there are too many, which is refused elsewhere.
pub(crate) fn points(axes: &[Axis], counts: impl Fn(&Axis) -> bool) -> Vec<Point> {
    let mut points: Vec<Point> = vec![Vec::with_capacity(axes.len())];
    for axis in axes {
        let choices: Vec<Option<usize>> =
            if counts(axis) { (0..axis.values.len()).map(Some).collect() } else { vec![None] };
        if points.len().saturating_mul(choices.len()) > MAX_NODES {
            return Vec::new();
        }
        let extended = |point: &Point| -> Vec<Point> {
            choices.iter().map(|choice| point.iter().copied().chain([*choice]).collect()).collect()
        };
        points = points.iter().flat_map(extended).collect();
    }
    points
}

/// A point at which only the axes that count have a value.
pub(crate) fn restricted(axes: &[Axis], point: &[Option<usize>], counts: impl Fn(&Axis) -> bool) -> Point {
    axes.iter().zip(point).map(|(axis, choice)| choice.filter(|_| counts(axis))).collect()
}
