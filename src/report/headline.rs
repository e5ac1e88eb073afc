//! The headline of a run: what its final results reach in the metric that they are judged by.

use super::outcomes::is_done;
use crate::{
    num::stats,
    run::{manifest::Manifest, node::NodeRecord},
    stage::Kind,
};

/// What a run reached.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Headline {
    /// The metric, as the kind of stage declares it (`Stage::HEADLINE`).
    pub metric: &'static str,
    /// The mean over models.
    pub mean: f64,
    /// The number of models.
    pub models: usize,
}

/// The headline of a run.
///
/// `None` where no final result is finished, or where final results differ in more than their seed: a mean over unlike
/// tasks, stages or parameters would mean nothing.
pub fn headline(manifest: &Manifest, kinds: &[Kind]) -> Option<Headline> {
    let metric_of = |node: &NodeRecord| node.about.work.kind_among(kinds)?.headline;
    let finals: Vec<&NodeRecord> =
        manifest.nodes.iter().filter(|node| node.about.is_last && metric_of(node).is_some()).collect();
    let metric = metric_of(finals.first()?)?;
    if !finals.windows(2).all(|pair| differ_by_seed_alone(pair[0], pair[1])) {
        return None;
    }
    let done = finals.iter().filter(|node| is_done(node));
    let values: Vec<f64> = done.filter_map(|node| node.outcome.metrics.get(metric).copied()).collect();
    (!values.is_empty()).then(|| Headline { metric, mean: stats::mean(&values), models: values.len() })
}

fn differ_by_seed_alone(one: &NodeRecord, other: &NodeRecord) -> bool {
    let point =
        |node: &NodeRecord| node.about.point.iter().filter(|(axis, _)| axis != "seed").cloned().collect::<Vec<_>>();
    (one.about.member, &one.about.stage, &one.about.work.task, point(one))
        == (other.about.member, &other.about.stage, &other.about.work.task, point(other))
}
