//! Decides which node works next, and takes in the outcome of every job.

mod journal;
mod node_run;
mod queues;

use std::{collections::BTreeSet, sync::atomic::Ordering, time::Duration};

use rayon::prelude::*;

use super::{
    Options, Order, Report,
    executor::{Executor, Failure, Finished, JobOutcome},
};
use crate::{
    digest::Digest,
    pipeline::{Node, NodeId},
    run::{
        events::{Events, NodeState},
        job::{Job, JobInput},
        key,
        manifest::Manifest,
        plan::{LookedUp, Takes, look_up},
        runs::RunDir,
    },
    store::{Entry, KeyLock, Published, ResultStore},
};
use journal::Journal;
use node_run::{NodeRun, Phase};
use queues::Queues;

/// How often a node may be made again in one run because its output was damaged.
const REPAIRS: u32 = 2;

/// How often to ask for the lock of a key that another process works on.
const POLL: Duration = Duration::from_millis(25);

/// From this many keys on, look-ups use all cores.
const MANY: usize = 64;

/// A run in progress.
pub(super) struct Scheduler<'a> {
    store: &'a dyn ResultStore,
    order: &'a Order<'a>,
    options: &'a Options,
    journal: Journal<'a>,
    /// One for each node of the graph; `None` for nodes that are not wanted.
    nodes: Vec<Option<NodeRun>>,
    queues: Queues,
    /// The keys that this run has made.
    made: BTreeSet<Digest>,
}

impl<'a> Scheduler<'a> {
    pub(super) fn new(
        store: &'a dyn ResultStore,
        order: &'a Order<'a>,
        options: &'a Options,
        events: &'a Events<'a>,
        dir: &'a RunDir,
        manifest: Manifest,
    ) -> Self {
        let mut rows = 0..;
        let nodes = order.wanted.iter().map(|&wanted| if wanted { rows.next().map(NodeRun::new) } else { None });
        let nodes = nodes.collect();
        let queues = Queues::new(order);
        let journal = Journal::new(store, events, dir, manifest);
        Self { store, order, options, journal, nodes, queues, made: BTreeSet::new() }
    }

    /// Runs every wanted node that can run.
    ///
    /// # Errors
    /// The store or the system failed. Jobs that were under way have ended by then.
    pub(super) fn run(mut self, executor: &mut dyn Executor) -> anyhow::Result<Report> {
        let scheduled = self.schedule(executor);
        // After an error, a job that goes on needs the lock of its key until it ends.
        while self.queues.is_working() {
            if let Some(finished) = executor.wait(POLL) {
                self.set(finished.id, Phase::Stopped);
            }
        }
        scheduled?;
        self.journal.finish(&self.nodes)
    }

    fn schedule(&mut self, executor: &mut dyn Executor) -> anyhow::Result<()> {
        loop {
            self.look_up_waiting()?;
            if self.start_jobs(executor)? {
                continue; // A hit may have made further keys known.
            }
            if !self.queues.is_working() && !self.may_start() {
                return Ok(());
            }
            if let Some(finished) = executor.wait(POLL) {
                self.take_in(finished);
            }
        }
    }

    /// The entry of a node that is done.
    fn entry(&self, id: NodeId) -> Option<&Entry> {
        self.nodes[id].as_ref().and_then(NodeRun::entry)
    }

    /// Looks up every node whose inputs have become known. A hit may make further keys known.
    fn look_up_waiting(&mut self) -> anyhow::Result<()> {
        loop {
            let ids: Vec<NodeId> = self.queues.take_to_look_up().into_iter().collect();
            if ids.is_empty() {
                return Ok(());
            }
            let look_up = |&id: &NodeId| self.look_up_if_waiting(id).transpose();
            let found: Vec<(NodeId, Digest, LookedUp)> = if ids.len() < MANY {
                ids.iter().filter_map(look_up).collect::<anyhow::Result<_>>()?
            } else {
                ids.par_iter().filter_map(look_up).collect::<anyhow::Result<_>>()?
            };
            for (id, key, found) in found {
                match found {
                    LookedUp::Hit(entry) => self.take_hit(id, entry),
                    LookedUp::Stale(_) => self.set(id, Phase::Ready(key)),
                }
            }
        }
    }

    /// Looks up a node that waits and whose inputs are known.
    fn look_up_if_waiting(&self, id: NodeId) -> anyhow::Result<Option<(NodeId, Digest, LookedUp)>> {
        let waits = self.nodes[id].as_ref().is_some_and(|node| matches!(node.phase, Phase::Waiting));
        let Some(key) = self.key(id).filter(|_| waits) else { return Ok(None) };
        Ok(Some((id, key, look_up(key, self.takes(id, key), self.store)?)))
    }

    /// The key of a node, once all its inputs are done.
    fn key(&self, id: NodeId) -> Option<Digest> {
        key::digest_of_node(&self.order.graph.nodes[id], |source| self.entry(source).map(|entry| entry.output))
    }

    /// Moves a node to another phase.
    fn set(&mut self, id: NodeId, phase: Phase) {
        if let Some(node) = &mut self.nodes[id] {
            self.queues.enter(id, &phase);
            node.phase = phase;
        }
    }

    /// Which results of the store a node takes. A forced key is made once in a run.
    fn takes(&self, id: NodeId, key: Digest) -> Takes {
        if self.made.contains(&key) { Takes::Any } else { self.options.force.takes(self.order.graph, id) }
    }

    fn may_start(&self) -> bool {
        let is_stopping =
            self.options.stop.load(Ordering::Relaxed) || (!self.options.keep_going && self.queues.has_failed());
        !is_stopping && self.queues.has_ready()
    }

    /// Starts ready nodes whose key no other process works on, as many as there is room for; returns whether a node
    /// turned out to be a hit.
    fn start_jobs(&mut self, executor: &mut dyn Executor) -> anyhow::Result<bool> {
        let mut has_hits = false;
        let mut room = self.options.jobs.max(1).saturating_sub(self.queues.working());
        let mut last = None;
        while let Some(id) = self.queues.ready_after(last).filter(|_| room > 0 && self.may_start()) {
            last = Some(id);
            let Some(&Phase::Ready(key)) = self.nodes[id].as_ref().map(|node| &node.phase) else { continue };
            if self.queues.works_on(key) {
                continue;
            }
            let Some(lock) = self.store.try_lock(key)? else {
                self.say_waiting(id, key);
                continue;
            };
            // Another node or process may have made the key since it was looked up.
            match look_up(key, self.takes(id, key), self.store)? {
                LookedUp::Hit(entry) => {
                    self.take_hit(id, entry);
                    has_hits = true;
                }
                LookedUp::Stale(_) => {
                    self.start(id, key, lock, executor)?;
                    room -= 1;
                }
            }
        }
        Ok(has_hits)
    }

    fn start(
        &mut self,
        id: NodeId,
        key: Digest,
        lock: Box<dyn KeyLock>,
        executor: &mut dyn Executor,
    ) -> anyhow::Result<()> {
        let node = &self.order.graph.nodes[id];
        let job = self.job(node);
        self.journal.begin(node)?;
        executor.start(id, job)?;
        self.set(id, Phase::Running { key, _lock: lock });
        Ok(())
    }

    /// The job of a node whose inputs are all done.
    fn job(&self, node: &Node) -> Job {
        let inputs = |sources: &Vec<NodeId>| {
            sources.iter().filter_map(|&source| self.entry(source)).map(JobInput::from).collect()
        };
        Job::of(node, node.inputs.iter().map(|(_, sources)| inputs(sources)).collect(), self.options.cores)
    }

    /// Says which process works on the key of a node: once, and again when that process was stopped.
    fn say_waiting(&mut self, id: NodeId, key: Digest) {
        let Some(node) = &mut self.nodes[id] else { return };
        if !node.waiting.is_due() {
            return;
        }
        let holder = self.store.holder(key);
        if node.waiting.is_news(holder) {
            let by = holder.map_or_else(|| "another process".to_owned(), |holder| holder.to_string());
            let name = &self.order.graph.nodes[id].name;
            self.journal.say(name, &format!("waiting for {by}, which works on this node"));
        }
    }

    fn take_hit(&mut self, id: NodeId, entry: Box<Entry>) {
        // A node that ran and whose output was made again counts as one that ran.
        let has_run = self.nodes[id].as_ref().is_some_and(|node| node.has_run);
        let state = if has_run && self.made.contains(&entry.key_digest) { NodeState::Ran } else { NodeState::Cached };
        self.take_output(id, entry, 0.0, state);
    }

    fn take_output(&mut self, id: NodeId, entry: Box<Entry>, secs: f64, state: NodeState) {
        if let Some(node) = &mut self.nodes[id] {
            node.worked_secs = secs;
            self.journal.end_with(&self.order.graph.nodes[id], node, state, &entry);
            self.set(id, Phase::Done(entry));
        }
    }

    fn take_in(&mut self, Finished { id, outcome, secs }: Finished) {
        match outcome {
            JobOutcome::Published(published) => self.take_published(id, *published, secs),
            JobOutcome::Failed(failure) => self.end_without_output(id, Phase::Failed(failure), secs),
            JobOutcome::Stopped => self.end_without_output(id, Phase::Stopped, secs),
            JobOutcome::DamagedInput { made_by, problem } => self.make_again(id, made_by, &problem),
        }
    }

    fn take_published(&mut self, id: NodeId, published: Published, secs: f64) {
        let Published { entry, differs } = published;
        let node = &self.order.graph.nodes[id];
        if let Some(other) = differs {
            let (kind, first, other) = (node.kind.name, entry.output.short(), other.short());
            let text = format!("`{kind}` is not deterministic: the same key made {first} and now {other}");
            self.journal.warn(&node.name, text);
        }
        self.made.insert(entry.key_digest);
        if let Some(node) = &mut self.nodes[id] {
            node.has_run = true;
        }
        self.take_output(id, Box::new(entry), secs, NodeState::Ran);
    }

    /// Ends a running node as failed or stopped.
    fn end_without_output(&mut self, id: NodeId, phase: Phase, secs: f64) {
        let Some(node) = &mut self.nodes[id] else { return };
        self.queues.enter(id, &phase);
        if let Phase::Running { key, .. } = std::mem::replace(&mut node.phase, phase) {
            node.worked_secs = secs;
            self.journal.end_without_output(&self.order.graph.nodes[id], node, key);
        }
    }

    /// Makes a damaged output again, and lets the nodes that take it wait for that.
    fn make_again(&mut self, taker: NodeId, made_by: Digest, problem: &str) {
        let graph = self.order.graph;
        let sources = || graph.nodes[taker].inputs.iter().flat_map(|(_, sources)| sources).copied();
        let is_maker = |&id: &NodeId| self.entry(id).is_some_and(|entry| entry.key_digest == made_by);
        let Some(maker) = sources().find(is_maker) else {
            // The maker is at work again already, because another taker has found the damage.
            return self.set(taker, Phase::Waiting);
        };
        let name = &graph.nodes[maker].name;
        let repairs = self.nodes[maker].as_mut().map_or(0, NodeRun::count_repair);
        if repairs > REPAIRS {
            let text = format!("the output of {name} is damaged again and again: {problem}");
            return self.end_without_output(taker, Phase::Failed(Failure::System(text)), 0.0);
        }
        self.journal.warn(name, format!("the output of {name} cannot be used: {problem}; making it again"));
        self.set(maker, Phase::Waiting);
        self.set(taker, Phase::Waiting);
        // The output may come out differently this time, so keys that were computed from it no longer hold.
        for (id, node) in graph.nodes.iter().enumerate() {
            let takes_it = node.inputs.iter().any(|(_, sources)| sources.contains(&maker));
            if takes_it && self.nodes[id].as_ref().is_some_and(|node| matches!(node.phase, Phase::Ready(_))) {
                self.set(id, Phase::Waiting);
            }
        }
    }
}
