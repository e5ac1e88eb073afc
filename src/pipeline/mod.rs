//! A pipeline file, read and unrolled: `text -> parse -> expand -> check` gives a [`Graph`] of nodes, or all mistakes.

mod catalogue;
mod dag;
mod draft;
mod expand;
mod matrix;
mod order;
mod overrides;
mod params;
mod parse;
mod reach;
mod reference;
mod stage_table;
mod streams;
mod tree;
mod unroll;
mod wiring;
mod wording;

use serde_json::Value;

use crate::{
    diag::{Diagnostic, Diagnostics, Sources},
    env::Task,
    rng::Stream,
    stage::{Kind, Port},
};

pub use catalogue::{stages_json, stages_text};
pub use dag::{dag_mermaid, dag_text, dag_text_expanded};
pub use overrides::Overrides;

/// The index of a node in [`Graph::nodes`].
pub type NodeId = usize;

/// A checked pipeline, unrolled into nodes.
#[derive(Debug, Clone)]
pub struct Graph {
    /// `name` of the file.
    pub name: String,
    /// `description` of the file.
    pub description: String,
    /// Nodes in an order in which every input comes before what takes it.
    pub nodes: Vec<Node>,
}

/// One execution of one stage: a stage in one round, at one point of the matrix.
#[derive(Debug, Clone)]
pub struct Node {
    /// `represent`, `represent@3` or `represent@3[seed=2]`: unique in the graph.
    pub name: String,
    /// The stage's name in the file.
    pub stage: String,
    /// The round, where the stage is in the loop.
    pub round: Option<u32>,
    /// The point of the matrix: axis and value, only those axes that reach this node.
    pub point: Vec<(String, String)>,
    /// What it does.
    pub kind: &'static Kind,
    /// Every parameter, defaults written out.
    pub params: Value,
    /// The task, defaults written out.
    pub task: Task,
    /// The node's randomness.
    pub stream: Stream,
    /// What is connected to each port, in the order written; an optional port without a source has an empty list.
    pub inputs: Vec<(&'static Port, Vec<NodeId>)>,
    /// True for nodes of the last round and for stages outside of the loop: where results are read off.
    pub is_last: bool,
}

/// A pipeline file in memory.
#[derive(Debug, Clone, Copy)]
pub struct Source<'a> {
    /// The path as messages show it.
    pub path: &'a str,
    /// What it holds.
    pub bytes: &'a [u8],
}

/// Reads a pipeline file, changed by the command line, and unrolls it into nodes.
///
/// # Errors
/// All mistakes of the file and the arguments at once; a syntax error alone stops the reading.
pub fn load(source: &Source<'_>, overrides: &Overrides, kinds: &'static [Kind]) -> Result<Graph, Diagnostics> {
    let mut sources = Sources::default();
    sources.add(source.path, String::from_utf8_lossy(source.bytes));
    for argument in overrides.shown() {
        sources.add("<command line>", argument);
    }
    graph_of(source, &sources, kinds).map_err(|mistakes| Diagnostics::new(sources, mistakes))
}

fn graph_of(source: &Source<'_>, sources: &Sources, kinds: &'static [Kind]) -> Result<Graph, Vec<Diagnostic>> {
    let mut mistakes = Vec::new();
    let mut document = parse::document(source.bytes, sources)?;
    let arguments: Vec<(usize, &str)> = sources.texts().skip(1).collect();
    let applied = overrides::apply(&mut document, &arguments, &mut mistakes);
    let axes = matrix::written(&mut document, applied, &mut mistakes);
    let ranges = matrix::ranges(&axes, &mut mistakes);
    let mut draft = parse::draft(document, axes, &ranges, sources, kinds, &mut mistakes);
    expand::graph(&mut draft, kinds, mistakes)
}
