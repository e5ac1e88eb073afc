//! Orders cells so that every cell comes after those whose results it takes, round by round, or reports the circles.

use std::{
    cmp::Reverse,
    collections::{BTreeSet, BinaryHeap},
};

use super::cells::{Cell, CellId};
use crate::{
    diag::Diagnostic,
    pipeline::resolve::resolved::{Pipeline, Stage},
};

/// Orders the cells. Each circle is reported once.
pub(super) fn order(cells: &[Cell], pipeline: &Pipeline, mistakes: &mut Vec<Diagnostic>) -> Vec<CellId> {
    let mut downstream: Vec<Vec<CellId>> = vec![Vec::new(); cells.len()];
    let mut waits_for = vec![0_usize; cells.len()];
    for (at, cell) in cells.iter().enumerate() {
        for upstream in cell.upstream() {
            downstream[upstream.cell].push(at);
            waits_for[at] += 1;
        }
    }
    // Of the cells that are ready, the earliest round comes first, and within a round the order of the file counts.
    let rank = |at: CellId| Reverse((cells[at].round.unwrap_or(0), cells[at].stage, at));
    let mut ready: BinaryHeap<_> = (0..cells.len()).filter(|at| waits_for[*at] == 0).map(rank).collect();
    let mut ordered = Vec::with_capacity(cells.len());
    while let Some(Reverse((_, _, at))) = ready.pop() {
        ordered.push(at);
        for below in &downstream[at] {
            waits_for[*below] -= 1;
            if waits_for[*below] == 0 {
                ready.push(rank(*below));
            }
        }
    }
    if ordered.len() < cells.len() {
        mistakes.extend(circles(cells, &waits_for, pipeline));
    }
    ordered
}

/// Each circle among the cells that still wait, named by its stages.
fn circles(cells: &[Cell], waits_for: &[usize], pipeline: &Pipeline) -> Vec<Diagnostic> {
    let mut walked = vec![false; cells.len()];
    let mut known: BTreeSet<Vec<usize>> = BTreeSet::new();
    let mut mistakes = Vec::new();
    for start in (0..cells.len()).filter(|at| waits_for[*at] > 0) {
        let mut path = Vec::new();
        let mut at = start;
        while !walked[at] {
            walked[at] = true;
            path.push(at);
            // A cell that waits has an upstream cell that waits, so the walk ends only where it was before.
            let Some(next) = cells[at].upstream().find(|upstream| waits_for[upstream.cell] > 0) else { break };
            at = next.cell;
        }
        let Some(begin) = path.iter().position(|on_path| *on_path == at) else { continue };
        let stages: Vec<usize> = path[begin..].iter().map(|cell| cells[*cell].stage).collect();
        let mut members = stages.clone();
        members.sort_unstable();
        members.dedup();
        if known.insert(members) {
            mistakes.push(circle(&stages, &pipeline.stages));
        }
    }
    mistakes
}

fn circle(members: &[usize], stages: &[Stage]) -> Diagnostic {
    // The sentence begins with the stage that comes first in the file.
    let begin = members.iter().enumerate().min_by_key(|(_, stage)| **stage).map_or(0, |(at, _)| at);
    let mut turned: Vec<usize> = members[begin..].iter().chain(&members[..begin]).copied().collect();
    turned.dedup();
    let name = |at: usize| &stages[turned[at % turned.len()]].name;
    let links: Vec<String> = (0..turned.len()).map(|at| format!("`{}` from `{}`", name(at), name(at + 1))).collect();
    let (first, upstream) = (&stages[members[begin]], members[(begin + 1) % members.len()]);
    let reference = first.inputs.iter().flat_map(|input| &input.references).find(|one| one.stage == upstream);
    let span = reference.map_or(first.span.clone(), |reference| reference.span.clone());
    let message = match turned.as_slice() {
        [_] => format!("stage `{}` takes its own result", first.name),
        _ => format!("stages take from each other in a circle: {}", links.join(", ")),
    };
    Diagnostic::at(span, message).help("take from the round before with `@prev`, or break the circle")
}
