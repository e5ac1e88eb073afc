//! Refuses two stages that draw the same random numbers where their results are used as if they were independent.
//!
//! The stream of a node is (seed, kind, round, `stream`), so two stages of one kind draw the same numbers. This is
//! wanted where they are compared, as at two points of the matrix. It is a mistake where one input takes both and they
//! work on the same inputs, or on none, as two `generate_data` do: the second result repeats the first.

use std::collections::BTreeSet;

use super::resolved::{Pipeline, Stage};
use crate::diag::Diagnostic;

/// Reports each such pair once, at the later of the two.
pub(super) fn check(pipeline: &Pipeline, mistakes: &mut Vec<Diagnostic>) {
    let mut known = BTreeSet::new();
    for taker in &pipeline.stages {
        for input in &taker.inputs {
            let upstream: BTreeSet<usize> = input.references.iter().map(|reference| reference.stage).collect();
            for (one, other) in pairs(&upstream) {
                let (first, second) = (&pipeline.stages[one], &pipeline.stages[other]);
                if repeats(first, second, pipeline.rounds()) && known.insert((one, other)) {
                    let message = format!(
                        "`{}` and `{}` draw the same randomness, and `{}` of `{}` takes both",
                        first.name, second.name, input.port.name, taker.name
                    );
                    let help = format!("write `stream = \"{}\"` in `[stages.{0}]`", second.name);
                    mistakes.push(Diagnostic::at(second.span.clone(), message).help(help));
                }
            }
        }
    }
}

fn pairs(all: &BTreeSet<usize>) -> impl Iterator<Item = (usize, usize)> {
    all.iter().flat_map(|one| all.range(one + 1..).map(|other| (*one, *other)))
}

fn repeats(one: &Stage, other: &Stage, rounds: u32) -> bool {
    let (Some(kind), Some(other_kind)) = (one.kind, other.kind) else { return false };
    let share_a_round = match (one.from, other.from) {
        (None, None) => true,
        (None, Some(from)) | (Some(from), None) => from == 0,
        (Some(from), Some(other_from)) => from.max(other_from) < rounds,
    };
    kind.repeats
        && kind.name == other_kind.name
        && one.stream == other.stream
        && share_a_round
        && sources(one) == sources(other)
}

/// What a stage takes, in whatever order the file lists its inputs.
fn sources(stage: &Stage) -> BTreeSet<(&'static str, Vec<&str>)> {
    stage
        .inputs
        .iter()
        .map(|input| (input.port.name, input.references.iter().map(|one| one.text.as_str()).collect()))
        .collect()
}
