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
mod suite;
mod tree;
mod unroll;
mod wiring;
mod wording;

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::Value;
use toml::{Spanned, de::DeTable};

use crate::{
    diag::{Diagnostic, Diagnostics, Sources},
    env::Task,
    num::rng::Stream,
    stage::{Kind, Port},
};

pub use catalogue::{stages_json, stages_text};
pub use dag::{dag_mermaid, dag_text, dag_text_expanded};
pub use overrides::Overrides;

use overrides::{Applied, Argument, Sweep};
use params::no_table;
use tree::{Key, Tree, set};

/// The index of a node in [`Graph::nodes`].
pub type NodeId = usize;

/// A checked pipeline, unrolled into nodes.
#[derive(Debug, Clone)]
pub struct Graph {
    /// `name` of the file.
    pub name: String,
    /// `description` of the file.
    pub description: String,
    /// The pipelines that it consists of: one, or those of a suite.
    pub members: Vec<Member>,
    /// Nodes in an order in which every input comes before what takes it.
    pub nodes: Vec<Node>,
}

/// A pipeline of a graph. Nothing of it reaches a key.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Member {
    /// Its name in the suite; empty where the graph is this pipeline alone.
    pub name: String,
    /// `name` of its file.
    pub pipeline: String,
    /// Its file.
    pub file: String,
    /// `[labels]` of its file, and what the suite says over them.
    #[serde(default)]
    pub labels: BTreeMap<String, String>,
    /// What the file holds, where it is another than the one that was loaded.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub text: String,
}

impl Graph {
    /// Whether it was made from a suite.
    pub fn is_suite(&self) -> bool {
        self.members.iter().any(|member| !member.name.is_empty())
    }

    /// Whether a target means a node: its name, its stage, the member of a suite that it belongs to, or a stage of all
    /// members.
    pub fn is_named(&self, id: NodeId, target: &str) -> bool {
        let node = &self.nodes[id];
        let member = &self.members[node.member].name;
        let of_all = |name: &str| !member.is_empty() && name.split_once('/').is_some_and(|(_, rest)| rest == target);
        node.stage == target || node.name == target || (!member.is_empty() && member == target) || of_all(&node.stage)
    }
}

/// One execution of one stage: a stage in one round, at one point of the matrix.
#[derive(Debug, Clone)]
pub struct Node {
    /// `represent`, `represent@3` or `represent@3[seed=2]`, in a suite behind its member, `planar_online/represent@3`:
    /// unique in the graph.
    pub name: String,
    /// The stage's name in the file; in a suite behind its member, `planar_online/represent`.
    pub stage: String,
    /// Index into [`Graph::members`].
    pub member: usize,
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

/// Reads the file that a suite names, by its path there: the path as messages show it, and what it holds, or why not.
pub type Reader<'a> = &'a dyn Fn(&str) -> Result<(String, Vec<u8>), String>;

/// Reads a pipeline file, changed by the command line, and unrolls it into nodes.
///
/// # Errors
/// All mistakes of the file and the arguments at once; a syntax error alone stops the reading.
pub fn load(source: &Source<'_>, overrides: &Overrides, kinds: &'static [Kind]) -> Result<Graph, Diagnostics> {
    load_with(source, overrides, kinds, &|_| Err("no other file can be read here".to_owned()))
}

/// Reads a pipeline file, or a suite and the pipelines that it names.
///
/// # Errors
/// All mistakes of all files and the arguments at once.
pub fn load_with(
    source: &Source<'_>,
    overrides: &Overrides,
    kinds: &'static [Kind],
    read: Reader<'_>,
) -> Result<Graph, Diagnostics> {
    let mut sources = Sources::default();
    sources.add(source.path, String::from_utf8_lossy(source.bytes));
    for argument in overrides.shown() {
        sources.add("<command line>", argument);
    }
    let arguments: Vec<Argument<'_>> = sources.texts().skip(1).map(Argument::read).collect();
    let loaded = match parse::document(source.bytes, &sources) {
        Err(mistakes) => Err(mistakes),
        Ok(document) if document.contains_key("suite") => {
            return suite::load(document, &sources, source.path, overrides, kinds, read);
        }
        Ok(document) => graph_of(document, &sources, &arguments, Addition::default(), kinds),
    };
    let mut graph = loaded.map_err(|mistakes| Diagnostics::new(sources, mistakes))?;
    graph.members[0].file = source.path.to_owned();
    Ok(graph)
}

/// What a suite adds to a pipeline; its places are in the same sources.
#[derive(Debug, Default)]
struct Addition<'i> {
    seeds: Option<Sweep<'i>>,
    set: Vec<(Vec<Key<'i>>, Tree<'i>)>,
    labels: DeTable<'i>,
}

fn graph_of<'i>(
    mut document: DeTable<'i>,
    sources: &'i Sources,
    arguments: &[Argument<'i>],
    addition: Addition<'i>,
    kinds: &'static [Kind],
) -> Result<Graph, Vec<Diagnostic>> {
    let mut mistakes = Vec::new();
    let mut applied = Applied::default();
    for (keys, value) in addition.set {
        let path = matrix::path_of(&keys, sources);
        mistakes.extend(overrides::set_path(&mut document, path, value, &mut applied).err());
    }
    for (key, value) in addition.labels {
        let path = [Spanned::new(key.span(), "labels".into()), key];
        mistakes.extend(set(&mut document, &path, value).err().map(|key| no_table(&key)));
    }
    applied.sweeps.extend(addition.seeds);
    overrides::apply(&mut document, arguments, &mut applied, &mut mistakes);
    let axes = matrix::written(&mut document, applied, &mut mistakes);
    let ranges = matrix::ranges(&axes, &mut mistakes);
    let mut draft = parse::draft(document, axes, &ranges, sources, kinds, &mut mistakes);
    expand::graph(&mut draft, kinds, mistakes)
}
