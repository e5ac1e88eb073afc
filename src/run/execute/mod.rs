//! Makes what is wanted: hits are taken from the store, the rest runs in parallel, and each result may stop the wave.
//!
//! A failed, stopped or killed node publishes nothing, so the same command always goes on from what is finished.

mod cores;
mod host;
mod panics;
mod recording;
mod scheduler;
mod teams;
mod worker;

use std::{
    collections::BTreeMap,
    path::PathBuf,
    sync::{Arc, atomic::AtomicBool},
};

use super::{
    events::{Event, Events, Listener, NodeState, RunState},
    manifest::Manifest,
    plan::Force,
    runs::RunDir,
};
use crate::store::Store;
use crate::{digest::Digest, pipeline::Graph};

/// What to run.
#[derive(Debug)]
pub struct Order<'a> {
    /// The graph.
    pub graph: &'a Graph,
    /// Which of its nodes, with all they need (see [`super::plan::select`]).
    pub wanted: Vec<bool>,
    /// The pipeline file, for the manifest.
    pub text: &'a str,
    /// The command, for the manifest.
    pub argv: Vec<String>,
}

/// How to run it.
#[derive(Debug, Clone)]
pub struct Options {
    /// How many nodes at once.
    pub jobs: usize,
    /// How many cores they share.
    pub cores: usize,
    /// Go on with independent nodes after a failure.
    pub keep_going: bool,
    /// Nodes to run although the store has their output.
    pub force: Force,
    /// Set once the user asked to stop.
    pub stop: Arc<AtomicBool>,
}

impl Default for Options {
    fn default() -> Self {
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        Self { jobs: cores, cores, keep_going: false, force: Force::None, stop: Arc::default() }
    }
}

/// What became of a run.
#[derive(Debug)]
pub struct Report {
    /// The run's id.
    pub run: String,
    /// The folder of the run.
    pub path: PathBuf,
    /// How it ended.
    pub state: RunState,
    /// Every wanted node.
    pub nodes: Vec<NodeReport>,
    /// From start to end.
    pub wall_secs: f64,
}

/// What became of a node.
#[derive(Debug)]
pub struct NodeReport {
    /// Its name.
    pub name: String,
    /// Its stage.
    pub stage: String,
    /// Its round.
    pub round: Option<u32>,
    /// How it ended.
    pub state: NodeState,
    /// How long it worked in this run.
    pub secs: f64,
    /// The content digest of its output.
    pub digest: Option<Digest>,
    /// The digest of the messages it recorded.
    pub recording: Option<Digest>,
    /// Its metrics.
    pub metrics: BTreeMap<String, f64>,
    /// What went wrong.
    pub failure: Option<Failure>,
}

/// Why a node failed.
#[derive(Debug, Clone)]
pub struct Failure {
    /// What went wrong, with every cause.
    pub text: String,
    /// The store or the system failed, not the stage.
    pub is_store: bool,
}

impl Report {
    /// How many nodes ended in a state.
    pub fn count(&self, state: NodeState) -> usize {
        self.nodes.iter().filter(|node| node.state == state).count()
    }
}

/// Runs an order; the folder of the run tells everything about it.
///
/// # Errors
/// The store or the system failed; a stage that fails is in the report.
pub fn run(store: &Store, order: &Order<'_>, options: &Options, listener: &dyn Listener) -> anyhow::Result<Report> {
    let dir = RunDir::create(&store.runs())?;
    dir.point_latest()?;
    let events = Events::create(&dir.path, listener)?;
    let manifest = Manifest::begin(&dir.id, order.graph, &order.wanted, order.text, &order.argv);
    let mut seeds: Vec<_> = manifest.nodes.iter().map(|node| node.stream.seed).collect();
    seeds.dedup();
    events.tell(&Event::RunStarted {
        run: dir.id.clone(),
        pipeline: order.graph.name.clone(),
        seed: if let [seed] = seeds[..] { Some(seed) } else { None },
        nodes: manifest.nodes.len(),
    });
    panics::keep_quiet();
    scheduler::Scheduler::new(store, order, options, &events, &dir, manifest).run()
}
