//! A resolved pipeline to a [`Graph`]: loop and matrix unrolled into nodes, once everything is checked.

use std::collections::BTreeMap;

use serde_json::Value;

use super::{
    cells::{Cell, CellId, Upstream, cells, too_large},
    node::{Graph, Member, Node, NodeFile, NodeId},
    order::order,
    reach::reach,
};
use crate::{
    diag::Diagnostic,
    node_name::NodeName,
    num::{self, rng::Stream},
    pipeline::{
        limits::MAX_NODES,
        resolve::{
            params::ParameterResolver,
            points::{Point, points, reaches_params},
            resolved::{Pipeline, Target},
        },
    },
    stage::{Arity, Kind, NamedFile, Outside, Port},
};

/// Unrolls the pipeline. `mistakes` are those already found; with them there is no graph, but all other mistakes.
pub(crate) fn graph(
    pipeline: &Pipeline,
    outside: &dyn Outside,
    mut mistakes: Vec<Diagnostic>,
) -> Result<Graph, Vec<Diagnostic>> {
    let mut resolver = ParameterResolver::new(pipeline, outside);
    let loop_broken = pipeline.stages.iter().any(|stage| stage.loop_broken);
    let Some(cells) = (if loop_broken { None } else { cells(pipeline, &mut mistakes) }) else {
        resolver.resolve_all();
        mistakes.append(&mut resolver.mistakes);
        return Err(mistakes);
    };
    let order = order(&cells, pipeline, &mut mistakes);
    let most = count(&reach(&cells, &order, pipeline, &|_| true), pipeline);
    if most > MAX_NODES {
        mistakes.push(too_large(most, "nodes", MAX_NODES, pipeline));
        return Err(mistakes);
    }
    resolver.resolve_all();
    let differs = preset_differs(pipeline, &mut resolver);
    let reached = reach(&cells, &order, pipeline, &|cell| {
        differs[&(cell.stage, pipeline.stages[cell.stage].is_first(cell.round))]
    });
    mistakes.append(&mut resolver.mistakes);
    if mistakes.is_empty() {
        check_gathered(&cells, &reached, pipeline, &mut mistakes);
    }
    if !mistakes.is_empty() {
        return Err(mistakes);
    }
    let starts = vec![0; cells.len()];
    let mut unrolling = Unrolling { pipeline, cells: &cells, reached: &reached, starts, resolver };
    let nodes = unrolling.nodes(&order).ok_or(unrolling.resolver.mistakes)?;
    let Pipeline { name, description, labels, .. } = pipeline;
    let member = Member { pipeline: name.clone(), labels: labels.clone(), ..Member::default() };
    Ok(Graph { name: name.clone(), description: description.clone(), members: vec![member], nodes })
}

/// How many nodes there are if these axes reach these cells.
fn count(reached: &[Vec<usize>], pipeline: &Pipeline) -> usize {
    reached.iter().fold(0, |sum: usize, axes| sum.saturating_add(size(axes, pipeline)))
}

/// How many points these axes have.
fn size(axes: &[usize], pipeline: &Pipeline) -> usize {
    axes.iter().fold(1, |size: usize, axis| size.saturating_mul(pipeline.axes[*axis].values.len()))
}

/// Whether the axis `preset` changes the parameters of a stage, in its first round and in others.
fn preset_differs(pipeline: &Pipeline, resolver: &mut ParameterResolver<'_>) -> BTreeMap<(usize, bool), bool> {
    let axis = pipeline.axes.iter().position(|axis| axis.target == Target::Preset);
    let mut differs = BTreeMap::new();
    for at in 0..pipeline.stages.len() {
        for in_first in [false, true] {
            let changes = axis.is_some_and(|axis| preset_changes(axis, at, in_first, pipeline, resolver));
            differs.insert((at, in_first), changes);
        }
    }
    differs
}

fn preset_changes(
    axis: usize,
    at: usize,
    in_first: bool,
    pipeline: &Pipeline,
    resolver: &mut ParameterResolver<'_>,
) -> bool {
    let values = pipeline.axes[axis].values.len();
    let others = points(&pipeline.axes, |other| other.target != Target::Preset && reaches_params(other, at));
    let mut any = |mut point: Point| {
        let mut at_value = |value| {
            point[axis] = Some(value);
            resolver.params(at, in_first, &point)
        };
        let first = at_value(0);
        (1..values).any(|value| at_value(value) != first)
    };
    values == 1 || others.into_iter().any(&mut any)
}

/// Refuses `[*]` into a port that takes one result where there are several points.
fn check_gathered(cells: &[Cell], reached: &[Vec<usize>], pipeline: &Pipeline, mistakes: &mut Vec<Diagnostic>) {
    for cell in cells {
        for input in cell.inputs.iter().filter(|input| input.port.arity != Arity::Many) {
            let Port { name, artifact, .. } = input.port;
            let gathering = input.upstream.iter().filter(|upstream| upstream.gathers);
            let gathered: usize = gathering.map(|upstream| size(&reached[upstream.cell], pipeline)).sum();
            let written = pipeline.stages[cell.stage].inputs.iter().find(|written| written.port.name == *name);
            if let Some(reference) = written.and_then(|written| written.references.first())
                && gathered > 1
            {
                let message = format!("input `{name}` takes one {artifact}, but gets {gathered}");
                let mistake = Diagnostic::at(reference.span.clone(), message).label("from all points of the matrix");
                mistakes.push(mistake.help("leave `[*]` out for this node's own point"));
            }
        }
    }
}

/// The nodes as they are made. The nodes of one cell follow each other, the last axis varies fastest.
struct Unrolling<'a> {
    pipeline: &'a Pipeline,
    cells: &'a [Cell],
    /// For each cell the axes that reach it.
    reached: &'a [Vec<usize>],
    /// The first node of each cell.
    starts: Vec<NodeId>,
    resolver: ParameterResolver<'a>,
}

impl Unrolling<'_> {
    fn nodes(&mut self, order: &[CellId]) -> Option<Vec<Node>> {
        let mut nodes = Vec::new();
        let base = self.resolver.base();
        for &at in order {
            self.starts[at] = nodes.len();
            for index in 0..size(&self.reached[at], self.pipeline) {
                let point = self.point(at, index, &base);
                nodes.push(self.node(at, &point)?);
            }
        }
        Some(nodes)
    }

    fn node(&mut self, at: CellId, point: &[Option<usize>]) -> Option<Node> {
        let (pipeline, cell) = (self.pipeline, &self.cells[at]);
        let stage = &pipeline.stages[cell.stage];
        let kind = stage.kind?;
        let shown = self.reached[at].iter().map(|axis| {
            let axis_at = &pipeline.axes[*axis];
            (axis_at.name.clone(), axis_at.values[point[*axis].unwrap_or(0)].text.clone())
        });
        let shown: Vec<(String, String)> = shown.collect();
        let name = NodeName { member: None, stage: stage.name.clone(), round: cell.round, point: shown.clone() };
        let params = self.resolver.params(cell.stage, stage.is_first(cell.round), point)?;
        Some(Node {
            files: self.files(kind, &params),
            name: name.to_string(),
            stage: stage.name.clone(),
            member: 0,
            round: cell.round,
            point: shown,
            kind,
            params,
            task: self.resolver.task(point)?,
            stream: Stream {
                seed: self.seed(point),
                kind: kind.name.to_owned(),
                round: cell.round.unwrap_or(0),
                stream: stage.stream.clone(),
            },
            platform: num::PLATFORM,
            inputs: self.inputs(cell, point),
            is_last: cell.round.is_none_or(|round| round + 1 == pipeline.rounds()),
        })
    }

    /// The files that parameters name, where they lie.
    fn files(&self, kind: &Kind, params: &Value) -> Vec<NodeFile> {
        let place = |NamedFile { path, content }| NodeFile { content, place: self.resolver.outside.place(&path) };
        (kind.files)(params).unwrap_or_default().into_iter().map(place).collect()
    }

    /// The point of the `index`-th node of a cell.
    fn point(&self, at: CellId, mut index: usize, base: &[Option<usize>]) -> Point {
        let mut point = base.to_vec();
        for axis in self.reached[at].iter().rev() {
            let count = self.pipeline.axes[*axis].values.len();
            point[*axis] = Some(index % count);
            index /= count;
        }
        point
    }

    fn inputs(&self, cell: &Cell, point: &[Option<usize>]) -> Vec<(&'static Port, Vec<NodeId>)> {
        let nodes = |upstream: &Upstream| self.upstream_nodes(upstream, point);
        cell.inputs.iter().map(|input| (input.port, input.upstream.iter().flat_map(nodes).collect())).collect()
    }

    /// The nodes of a cell that a node at `point` takes from.
    fn upstream_nodes(&self, upstream: &Upstream, point: &[Option<usize>]) -> std::ops::Range<NodeId> {
        let axes = &self.reached[upstream.cell];
        let start = self.starts[upstream.cell];
        if upstream.gathers {
            return start..start + size(axes, self.pipeline);
        }
        let count = |axis: usize| self.pipeline.axes[axis].values.len();
        let index = axes.iter().fold(0, |index, axis| index * count(*axis) + point[*axis].unwrap_or(0));
        start + index..start + index + 1
    }

    fn seed(&self, point: &[Option<usize>]) -> u64 {
        let axis = self.pipeline.axes.iter().position(|axis| axis.target == Target::Seed);
        let chosen = axis.and_then(|axis| Some(&self.pipeline.axes[axis].values[point[axis]?].value));
        chosen.and_then(|tree| tree.value.to_json().as_u64()).unwrap_or(self.pipeline.seed)
    }
}
