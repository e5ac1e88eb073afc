//! [`Draft`] to [`Graph`]: loop and matrix unrolled into nodes, once everything is checked.

use std::collections::BTreeMap;

use super::{
    Graph, Member, Node, NodeId,
    draft::{Draft, Target},
    matrix::MAX_NODES,
    order::order,
    params::{Point, Settler, points, reaches_params},
    reach::reach,
    streams,
    tree::to_json,
    unroll::{Cell, CellId, cells, too_large},
    wiring,
};
use crate::{
    diag::Diagnostic,
    node_name::NodeName,
    num::rng::Stream,
    stage::{Arity, Kind},
};

/// Checks the draft and unrolls it; `mistakes` are those already found.
pub(super) fn graph(
    draft: &mut Draft<'_>,
    kinds: &[Kind],
    mut mistakes: Vec<Diagnostic>,
) -> Result<Graph, Vec<Diagnostic>> {
    wiring::check(&mut draft.stages, draft.rounds, kinds, &mut mistakes);
    let draft = &*draft;
    streams::check(draft, &mut mistakes);
    let mut settler = Settler::new(draft);
    let cells = if draft.stages.iter().any(|stage| stage.loop_broken) { None } else { cells(draft, &mut mistakes) };
    let Some(cells) = cells else {
        settler.settle_all();
        mistakes.append(&mut settler.mistakes);
        return Err(mistakes);
    };
    let order = order(&cells, draft, &mut mistakes);
    let most = reach(&cells, &order, draft, &|_| true);
    let count = count(&most, draft);
    if count > MAX_NODES {
        mistakes.push(too_large(count, "nodes", draft));
        return Err(mistakes);
    }
    settler.settle_all();
    let differs = preset_differs(draft, &mut settler);
    let reached =
        reach(&cells, &order, draft, &|cell| differs[&(cell.stage, cell.is_first(&draft.stages[cell.stage]))]);
    mistakes.append(&mut settler.mistakes);
    if mistakes.is_empty() {
        check_gathered(&cells, &reached, draft, &mut mistakes);
    }
    if !mistakes.is_empty() {
        return Err(mistakes);
    }
    let mut unrolling = Unrolling { draft, cells: &cells, reached: &reached, starts: vec![0; cells.len()], settler };
    let nodes = unrolling.nodes(&order).ok_or(unrolling.settler.mistakes)?;
    let member = Member {
        name: String::new(),
        pipeline: draft.name.clone(),
        file: String::new(),
        labels: draft.labels.clone(),
        text: String::new(),
    };
    Ok(Graph { name: draft.name.clone(), description: draft.description.clone(), members: vec![member], nodes })
}

/// How many nodes there are if these axes reach these cells.
fn count(reached: &[Vec<usize>], draft: &Draft<'_>) -> usize {
    reached.iter().fold(0, |sum: usize, axes| sum.saturating_add(size(axes, draft)))
}

fn size(axes: &[usize], draft: &Draft<'_>) -> usize {
    axes.iter().fold(1, |size: usize, axis| size.saturating_mul(draft.axes[*axis].values.len()))
}

/// Whether the axis `preset` changes the parameters of a stage, in its first round and in others.
fn preset_differs(draft: &Draft<'_>, settler: &mut Settler<'_, '_>) -> BTreeMap<(usize, bool), bool> {
    let axis = draft.axes.iter().position(|axis| axis.target == Target::Preset);
    let mut differs = BTreeMap::new();
    for at in 0..draft.stages.len() {
        for in_first in [false, true] {
            let mut changes = |axis: usize| {
                let values = draft.axes[axis].values.len();
                let others = points(&draft.axes, |other| other.target != Target::Preset && reaches_params(other, at));
                values == 1
                    || others.into_iter().any(|mut point| {
                        let mut at_value = |value| {
                            point[axis] = Some(value);
                            settler.params(at, in_first, &point)
                        };
                        let first = at_value(0);
                        (1..values).any(|value| at_value(value) != first)
                    })
            };
            differs.insert((at, in_first), axis.is_some_and(&mut changes));
        }
    }
    differs
}

/// `[*]` into a port for one is a mistake where there are several points.
fn check_gathered(cells: &[Cell], reached: &[Vec<usize>], draft: &Draft<'_>, mistakes: &mut Vec<Diagnostic>) {
    for cell in cells {
        for (port, givers) in cell.inputs.iter().filter(|(port, _)| port.arity != Arity::Many) {
            let gathered: usize =
                givers.iter().filter(|giver| giver.gathers).map(|giver| size(&reached[giver.cell], draft)).sum();
            let input = draft.stages[cell.stage].inputs.iter().find(|input| input.port.name == port.name);
            if let Some(reference) = input.and_then(|input| input.references.first())
                && gathered > 1
            {
                let message = format!("input `{}` takes one {}, but gets {gathered}", port.name, port.artifact);
                let mistake = Diagnostic::at(reference.span.clone(), message).label("from all points of the matrix");
                mistakes.push(mistake.help("leave `[*]` out for this node's own point"));
            }
        }
    }
}

/// The nodes as they are made: those of one cell follow each other, the last axis fastest.
struct Unrolling<'a, 'i> {
    draft: &'a Draft<'i>,
    cells: &'a [Cell],
    reached: &'a [Vec<usize>],
    starts: Vec<NodeId>,
    settler: Settler<'a, 'i>,
}

impl Unrolling<'_, '_> {
    fn nodes(&mut self, order: &[CellId]) -> Option<Vec<Node>> {
        let mut nodes = Vec::new();
        let base = self.settler.base();
        for &at in order {
            self.starts[at] = nodes.len();
            for index in 0..size(&self.reached[at], self.draft) {
                nodes.push(self.node(at, index, &base)?);
            }
        }
        Some(nodes)
    }

    fn node(&mut self, at: CellId, index: usize, base: &[Option<usize>]) -> Option<Node> {
        let (draft, cell) = (self.draft, &self.cells[at]);
        let stage = &draft.stages[cell.stage];
        let point = self.point(at, index, base);
        let kind = stage.kind?;
        let text = |axis: &usize| {
            let value = &draft.axes[*axis].values[point[*axis].unwrap_or(0)];
            (draft.axes[*axis].name.clone(), value.text.clone())
        };
        let shown: Vec<(String, String)> = self.reached[at].iter().map(text).collect();
        Some(Node {
            name: NodeName { member: None, stage: stage.name.clone(), round: cell.round, point: shown.clone() }
                .to_string(),
            stage: stage.name.clone(),
            member: 0,
            round: cell.round,
            point: shown,
            kind,
            params: self.settler.params(cell.stage, cell.is_first(stage), &point)?,
            task: self.settler.task(&point)?,
            stream: Stream {
                seed: self.seed(&point),
                kind: kind.name.to_owned(),
                round: cell.round.unwrap_or(0),
                stream: stage.stream.clone(),
            },
            inputs: self.inputs(cell, &point),
            is_last: cell.round.is_none_or(|round| round + 1 == draft.rounds),
        })
    }

    /// The point of the `index`-th node of a cell.
    fn point(&self, at: CellId, mut index: usize, base: &[Option<usize>]) -> Point {
        let mut point = base.to_vec();
        for axis in self.reached[at].iter().rev() {
            let count = self.draft.axes[*axis].values.len();
            point[*axis] = Some(index % count);
            index /= count;
        }
        point
    }

    fn inputs(&self, cell: &Cell, point: &[Option<usize>]) -> Vec<(&'static crate::stage::Port, Vec<NodeId>)> {
        let of_port = |(port, givers): &(&'static crate::stage::Port, Vec<super::unroll::Giver>)| {
            let mut nodes = Vec::with_capacity(givers.len());
            for giver in givers {
                let axes = &self.reached[giver.cell];
                let start = self.starts[giver.cell];
                if giver.gathers {
                    nodes.extend(start..start + size(axes, self.draft));
                } else {
                    let index = axes
                        .iter()
                        .fold(0, |index, axis| index * self.draft.axes[*axis].values.len() + point[*axis].unwrap_or(0));
                    nodes.push(start + index);
                }
            }
            (*port, nodes)
        };
        cell.inputs.iter().map(of_port).collect()
    }

    fn seed(&self, point: &[Option<usize>]) -> u64 {
        let axis = self.draft.axes.iter().position(|axis| axis.target == Target::Seed);
        let chosen = axis.and_then(|axis| Some(&self.draft.axes[axis].values[point[axis]?].value));
        chosen.and_then(|value| to_json(value.get_ref()).as_u64()).unwrap_or(self.draft.seed)
    }
}
