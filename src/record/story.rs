//! One time axis for a whole run: its nodes laid end to end, each after all that finished before it started.
//!
//! Every node counts its steps from 0, so drawn as they are, round 3 would lie on top of round 0. The offsets follow
//! from the order of a run's events alone; a run shown live and shown again later looks the same.

use std::collections::BTreeMap;

/// Steps and epochs since the run began.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Offset {
    pub step: u64,
    pub epoch: u64,
}

impl Offset {
    pub(super) fn later(self, other: Offset) -> Offset {
        Offset { step: self.step.max(other.step), epoch: self.epoch.max(other.epoch) }
    }
}

/// How far the finished nodes reach.
#[derive(Debug, Default)]
pub(super) struct Story {
    /// By point of the matrix, since points run side by side; `""` for nodes that all points share.
    ends: BTreeMap<String, Offset>,
}

impl Story {
    /// Where a node begins that starts now.
    pub(super) fn start(&self, point: &str) -> Offset {
        let before = |other: &str| point.is_empty() || other.is_empty() || other == point;
        self.ends
            .iter()
            .filter(|(other, _)| before(other))
            .fold(Offset::default(), |latest, (_, end)| latest.later(*end))
    }

    /// A node finished there.
    pub(super) fn end(&mut self, point: &str, end: Offset) {
        let known = self.ends.entry(point.to_owned()).or_default();
        *known = known.later(end);
    }
}

/// A node's name without its round, `represent` or `represent[seed=3]`, and what runs beside others: its point of the
/// matrix, `seed=3`, and the member of a suite before it, `planar_online seed=3`.
pub(super) fn lane_and_point(node: &str) -> (String, String) {
    let stem = node.split(['@', '[']).next().unwrap_or(node);
    let point = node.split_once('[').and_then(|(_, rest)| rest.split_once(']')).map_or("", |(point, _)| point);
    let lane = if point.is_empty() { stem.to_owned() } else { format!("{stem}[{point}]") };
    let beside = stem.split_once('/').map_or(point.to_owned(), |(member, _)| format!("{member} {point}"));
    (lane, beside)
}

#[cfg(test)]
mod tests {
    use super::{Offset, Story, lane_and_point};

    #[test]
    fn points_of_a_matrix_lie_side_by_side_after_what_they_share() {
        let at = |step| Offset { step, epoch: 0 };
        let mut story = Story::default();
        story.end("", at(10));
        story.end("seed=1", at(30));
        assert_eq!(story.start("seed=2"), at(10));
        assert_eq!(story.start("seed=1"), at(30));
        assert_eq!(story.start(""), at(30));
    }

    #[test]
    fn a_lane_is_the_name_without_the_round() {
        let named = |node: &str| lane_and_point(node);
        assert_eq!(named("bootstrap"), ("bootstrap".into(), String::new()));
        assert_eq!(named("represent@3"), ("represent".into(), String::new()));
        assert_eq!(named("represent@3[seed=1]"), ("represent[seed=1]".into(), "seed=1".into()));
        assert_eq!(named("a/represent@3[seed=1]"), ("a/represent[seed=1]".into(), "a seed=1".into()));
        assert_eq!(named("represent[seed=1]@3"), ("represent[seed=1]".into(), "seed=1".into()));
    }
}
