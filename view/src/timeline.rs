//! The common time axis of a run: a node begins after every node that had finished when it started.
//!
//! Every node counts its steps from 0. Without offsets, round 3 would be drawn on top of round 0. The offsets depend
//! only on the order of the run's events, so a live view and a later view of the same run agree.

use std::collections::BTreeMap;

use carl_pipe::node_name::NodeName;

/// Steps and epochs since the run began.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Offset {
    pub step: u64,
    pub epoch: u64,
}

impl Offset {
    /// The later of both, for steps and epochs separately.
    pub(crate) fn max(self, other: Offset) -> Offset {
        Offset { step: self.step.max(other.step), epoch: self.epoch.max(other.epoch) }
    }
}

/// Where a node is drawn.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Lane {
    /// The node's name without its round: `represent` or `represent[seed=3]`.
    pub name: String,
    /// The part of the run that works in parallel to others: a point of the matrix, `seed=3`, or a member of a suite
    /// with its point, `planar_online seed=3`. Empty for nodes that all points share.
    pub branch: String,
}

impl Lane {
    /// The lane of a node. A text that is no node's name is a lane of that name.
    pub(crate) fn of(node: &str) -> Lane {
        let Ok(name) = node.parse::<NodeName>() else { return Lane { name: node.to_owned(), branch: String::new() } };
        let (stage, point) = (name.stage_path(), name.point_text());
        let branch = name.member.map_or(point.clone(), |member| format!("{member} {point}"));
        Lane { name: if point.is_empty() { stage } else { format!("{stage}[{point}]") }, branch }
    }
}

/// The end of every branch so far.
#[derive(Debug, Default)]
pub(crate) struct Timeline {
    ends: BTreeMap<String, Offset>,
}

impl Timeline {
    /// The beginning of a node that starts now.
    pub(crate) fn start(&self, branch: &str) -> Offset {
        let is_before = |other: &str| branch.is_empty() || other.is_empty() || other == branch;
        self.ends
            .iter()
            .filter(|(other, _)| is_before(other))
            .fold(Offset::default(), |latest, (_, end)| latest.max(*end))
    }

    /// Notes that a node of this branch ended at `end`.
    pub(crate) fn end(&mut self, branch: &str, end: Offset) {
        let known = self.ends.entry(branch.to_owned()).or_default();
        *known = known.max(end);
    }
}

#[cfg(test)]
mod tests {
    use super::{Lane, Offset, Timeline};

    #[test]
    fn points_of_a_matrix_lie_side_by_side_after_what_they_share() {
        let at = |step| Offset { step, epoch: 0 };
        let mut timeline = Timeline::default();
        timeline.end("", at(10));
        timeline.end("seed=1", at(30));
        assert_eq!(timeline.start("seed=2"), at(10));
        assert_eq!(timeline.start("seed=1"), at(30));
        assert_eq!(timeline.start(""), at(30));
    }

    #[test]
    fn a_lane_is_the_name_without_the_round() {
        let lane = |name: &str, branch: &str| Lane { name: name.into(), branch: branch.into() };
        assert_eq!(Lane::of("bootstrap"), lane("bootstrap", ""));
        assert_eq!(Lane::of("represent@3"), lane("represent", ""));
        assert_eq!(Lane::of("represent@3[seed=1]"), lane("represent[seed=1]", "seed=1"));
        assert_eq!(Lane::of("a/represent@3[seed=1]"), lane("a/represent[seed=1]", "a seed=1"));
        assert_eq!(Lane::of("represent[seed=1]@3"), lane("represent[seed=1]", "seed=1"));
        assert_eq!(Lane::of("my recording@home"), lane("my recording@home", ""));
    }
}
