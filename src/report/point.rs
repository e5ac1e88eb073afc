//! Points of a matrix without the axes that a comparison leaves out.

use crate::run::node::NodeRecord;

/// The values of the axes of a node's matrix except the seed.
pub(super) fn without_seed(node: &NodeRecord) -> Vec<(String, String)> {
    node.about.point.iter().filter(|(axis, _)| axis != "seed").cloned().collect()
}

/// A point without the axes that only set the number of samples.
pub(super) fn without_samples(point: Vec<(String, String)>) -> Vec<(String, String)> {
    point.into_iter().filter(|(axis, _)| !axis.ends_with(".samples")).collect()
}
