//! Makes the results that are wanted: takes those that the store has, and runs the rest in parallel.
//!
//! A node that failed, stopped or was killed publishes nothing, so the same command continues from what is finished.

mod cores;
mod executor;
mod host;
mod panics;
mod recording;
mod scheduler;
mod teams;
mod threads;
mod worker;

use std::{
    path::{Path, PathBuf},
    sync::{Arc, atomic::AtomicBool},
    thread,
};

use super::{
    events::{Event, Events, Listener, NodeState, RunState},
    manifest::Manifest,
    marks::Marks,
    named_files,
    node::NodeRecord,
    plan::Force,
    runs::RunDir,
    strays,
};
use crate::{pipeline::Graph, stage::Kind, store::ResultStore};

pub use executor::{Executor, Failure, Finished, JobOutcome};
pub use worker::{RunContext, Worker};

/// What to run.
#[derive(Debug)]
pub struct Order<'a> {
    /// The graph.
    pub graph: &'a Graph,
    /// Which of its nodes, with all that they need (see [`super::plan::select`]).
    pub wanted: Vec<bool>,
    /// The text of the pipeline file, for the manifest.
    pub text: &'a str,
    /// The command, for the manifest.
    pub argv: Vec<String>,
    /// What the run is for, in the user's words.
    pub note: Option<String>,
}

/// How to run it.
#[derive(Debug, Clone)]
pub struct Options {
    /// How many nodes may run at once.
    pub jobs: usize,
    /// How many cores they share.
    pub cores: usize,
    /// Whether independent nodes still start after a failure.
    pub keep_going: bool,
    /// Which nodes run although the store has their output.
    pub force: Force,
    /// Set once the user asked to stop.
    pub stop: Arc<AtomicBool>,
}

impl Default for Options {
    fn default() -> Self {
        let cores = thread::available_parallelism().map_or(1, usize::from);
        Self { jobs: cores, cores, keep_going: false, force: Force::None, stop: Arc::default() }
    }
}

/// What became of a run.
#[derive(Debug)]
pub struct Report {
    /// The id of the run.
    pub run: String,
    /// The folder of the run.
    pub path: PathBuf,
    /// How it ended.
    pub state: RunState,
    /// The manifest as its folder keeps it.
    pub manifest: Manifest,
    /// What the manifest does not hold of each node, in the order of its nodes.
    pub ends: Vec<NodeEnd>,
    /// Seconds from start to end.
    pub wall_secs: f64,
}

/// What this run knows of a node beyond the record in the manifest.
#[derive(Debug)]
pub struct NodeEnd {
    /// Seconds that it worked in this run.
    pub worked_secs: f64,
    /// Why it failed.
    pub failure: Option<Failure>,
}

/// What became of a node in a run.
#[derive(Debug, Clone, Copy)]
pub struct NodeReport<'a> {
    /// The record of the node in the manifest.
    pub record: &'a NodeRecord,
    /// Seconds that it worked in this run.
    pub worked_secs: f64,
    /// Why it failed.
    pub failure: Option<&'a Failure>,
}

impl Report {
    /// Every wanted node, inputs first.
    pub fn nodes(&self) -> impl DoubleEndedIterator<Item = NodeReport<'_>> {
        let both = self.manifest.nodes.iter().zip(&self.ends);
        both.map(|(record, end)| NodeReport { record, worked_secs: end.worked_secs, failure: end.failure.as_ref() })
    }

    /// What became of the node with this name.
    pub fn node(&self, name: &str) -> Option<NodeReport<'_>> {
        self.nodes().find(|node| node.record.about.name == name)
    }

    /// How many nodes ended in a state.
    pub fn count(&self, state: NodeState) -> usize {
        self.manifest.nodes.iter().filter(|node| node.outcome.state == state).count()
    }
}

/// Runs an order in threads of this process. The folder of the run, below `runs`, keeps everything about it.
///
/// # Errors
/// The store or the system failed. A stage that fails is in the report.
pub fn run(
    store: &dyn ResultStore,
    runs: &Path,
    order: &Order<'_>,
    options: &Options,
    listener: &dyn Listener,
) -> anyhow::Result<Report> {
    let dir = RunDir::create(runs)?;
    strays::sweep_links(runs);
    let wanted = order.graph.nodes.iter().zip(&order.wanted).filter(|(_, wanted)| **wanted);
    named_files::keep(&dir.path, wanted.flat_map(|(node, _)| &node.files));
    if order.note.is_some() {
        Marks { note: order.note.clone(), ..Marks::default() }.write(&dir.path)?;
    }
    let events = Events::create(&dir.path, listener)?;
    let manifest = Manifest::begin((&dir.id, dir.number), order.graph, &order.wanted, order.text, &order.argv);
    events.emit(&Event::RunStarted {
        run: dir.id.clone(),
        number: Some(dir.number),
        pipeline: order.graph.name.clone(),
        seed: only_seed(&manifest),
        nodes: manifest.nodes.len(),
    });
    panics::keep_quiet();
    let kinds = kinds(order.graph);
    let (run, run_dir, stop) = (&*dir.id, &*dir.path, &*options.stop);
    let context = RunContext { store, kinds: &kinds, run, run_dir, events: &events, stop };
    let worker = Worker::new(context, options.cores);
    thread::scope(|scope| {
        let mut executor = threads::Threads::new(scope, &worker);
        scheduler::Scheduler::new(store, order, options, &events, &dir, manifest).run(&mut executor)
    })
}

/// The seed of all nodes, where all have the same.
fn only_seed(manifest: &Manifest) -> Option<u64> {
    let mut seeds: Vec<_> = manifest.nodes.iter().map(|node| node.about.work.stream.seed).collect();
    seeds.dedup();
    if let [seed] = seeds[..] { Some(seed) } else { None }
}

/// The kinds that the nodes of a graph have, each once.
fn kinds(graph: &Graph) -> Vec<&'static Kind> {
    let mut kinds: Vec<&'static Kind> = Vec::new();
    for node in &graph.nodes {
        if !kinds.iter().any(|kind| std::ptr::eq(*kind, node.kind)) {
            kinds.push(node.kind);
        }
    }
    kinds
}
