//! Decides which node works next, and takes in what became of it.

#![allow(
    clippy::disallowed_methods,
    reason = "wall times are kept beside a run and name its folder; no key and no result holds one"
)]

use std::{
    collections::{BTreeMap, BTreeSet},
    sync::{atomic::Ordering, mpsc},
    thread,
    time::{Duration, Instant},
};

use super::{
    Failure, NodeReport, Options, Order, Report,
    cores::Cores,
    recording::{link_name, live_name},
    teams::Teams,
    worker::{Ended, Job, Shop, work},
};
use crate::{
    digest::Digest,
    pipeline::{Node, NodeId},
    run::{
        events::{Event, Events, NodeState, RunState},
        key::Key,
        manifest::Manifest,
        plan::{State, look_up},
        runs::{RunDir, file_name},
    },
    store::{Entry, Store},
};

/// How often a node may have to be made again in one run because its output was damaged.
const REPAIRS: u32 = 2;

/// How often to ask for the lock of a key that another process works on.
const POLL: Duration = Duration::from_millis(25);

/// Where a node stands.
enum Status {
    /// An input is not there yet.
    Waiting,
    /// To run as soon as there is room, or as the process that works on it ends.
    Ready(Key),
    Running,
    Done(Box<Entry>),
    Failed(Failure),
    Stopped,
    NotWanted,
}

/// How often a run that goes on writes its manifest, so that a killed one shows what it had.
const MANIFEST_EVERY: Duration = Duration::from_secs(1);

/// A run in progress.
pub(super) struct Scheduler<'a> {
    store: &'a Store,
    order: &'a Order<'a>,
    options: &'a Options,
    events: &'a Events<'a>,
    dir: &'a RunDir,
    manifest: Manifest,
    status: Vec<Status>,
    /// The seconds of work and the state of every node that came to an end.
    ends: BTreeMap<NodeId, (f64, NodeState)>,
    /// Where each wanted node stands in the manifest.
    row: BTreeMap<NodeId, usize>,
    /// Keys that this process works on.
    running: BTreeMap<NodeId, Digest>,
    /// Keys that this run has made, so that a forced node runs once.
    made: BTreeSet<Digest>,
    repairs: BTreeMap<NodeId, u32>,
    /// Nodes that another process was seen to work on.
    elsewhere: BTreeSet<NodeId>,
    /// When the manifest was last written; never, until a node begins.
    written: Option<Instant>,
}

impl<'a> Scheduler<'a> {
    pub(super) fn new(
        store: &'a Store,
        order: &'a Order<'a>,
        options: &'a Options,
        events: &'a Events<'a>,
        dir: &'a RunDir,
        manifest: Manifest,
    ) -> Self {
        let status = order.wanted.iter().map(|&wanted| if wanted { Status::Waiting } else { Status::NotWanted });
        let wanted = (0..order.wanted.len()).filter(|&id| order.wanted[id]);
        Self {
            store,
            order,
            options,
            events,
            dir,
            manifest,
            status: status.collect(),
            ends: BTreeMap::new(),
            row: wanted.enumerate().map(|(row, id)| (id, row)).collect(),
            running: BTreeMap::new(),
            made: BTreeSet::new(),
            repairs: BTreeMap::new(),
            elsewhere: BTreeSet::new(),
            written: None,
        }
    }

    pub(super) fn run(mut self) -> anyhow::Result<Report> {
        let (store, events, dir, options) = (self.store, self.events, self.dir, self.options);
        let cores = Cores::new(options.cores);
        let teams = Teams::new(options.cores.max(1));
        let (run, run_dir) = (&*dir.id, &*dir.path);
        let shop = Shop { store, run, run_dir, events, cores: &cores, teams: &teams, stop: &options.stop };
        let (send, ends) = mpsc::channel();
        thread::scope(|scope| -> anyhow::Result<()> {
            loop {
                self.look_up_ready()?;
                let (jobs, has_hits) = self.next_jobs()?;
                for job in jobs {
                    self.begin(job.node)?;
                    let send = send.clone();
                    scope.spawn(move || {
                        let (id, key) = (job.id, job.key.clone());
                        let (ended, secs) = work(shop, job);
                        // The scheduler only goes away when every worker has ended.
                        let _ = send.send((id, key, ended, secs));
                    });
                }
                if has_hits {
                    continue; // What takes them may be looked up now.
                }
                if self.running.is_empty() && !self.may_start() {
                    return Ok(());
                }
                if let Ok((id, key, ended, secs)) = ends.recv_timeout(POLL) {
                    self.take_in(id, key, ended, secs);
                }
            }
        })?;
        self.finish()
    }

    /// Looks up every node whose inputs have become known; a hit may make more known.
    fn look_up_ready(&mut self) -> anyhow::Result<()> {
        for (id, node) in self.order.graph.nodes.iter().enumerate() {
            if !matches!(self.status[id], Status::Waiting) {
                continue;
            }
            let output = |source: NodeId| match &self.status[source] {
                Status::Done(entry) => Some(entry.output),
                _ => None,
            };
            if let Some(key) = Key::of(node, output) {
                let is_forced = self.is_forced(id, &key);
                match look_up(key, is_forced, self.store)? {
                    State::Hit(key, entry) => self.take_hit(id, &key, entry),
                    State::Stale(key, _) => self.status[id] = Status::Ready(key),
                    State::Waiting(_) => {}
                }
            }
        }
        Ok(())
    }

    fn is_forced(&self, id: NodeId, key: &Key) -> bool {
        self.options.force.has(self.order.graph, id) && !self.made.contains(&key.digest)
    }

    fn may_start(&self) -> bool {
        let is_stopping = self.options.stop.load(Ordering::Relaxed)
            || (!self.options.keep_going && self.status.iter().any(|status| matches!(status, Status::Failed(_))));
        !is_stopping && self.status.iter().any(|status| matches!(status, Status::Ready(_)))
    }

    /// Ready nodes whose key nobody else works on, as many as there is room for; and whether one has become a hit.
    fn next_jobs(&mut self) -> anyhow::Result<(Vec<Job<'a>>, bool)> {
        let (mut jobs, mut has_hits) = (Vec::new(), false);
        for id in 0..self.status.len() {
            if self.running.len() >= self.options.jobs.max(1) || !self.may_start() {
                break;
            }
            let Status::Ready(key) = &self.status[id] else { continue };
            let key = key.clone();
            if self.running.values().any(|&running| running == key.digest) {
                continue;
            }
            let Some(lock) = self.store.try_lock(key.digest)? else {
                self.tell_waiting(id);
                continue;
            };
            // Another node or process may have made it since the plan was drawn up.
            let is_forced = self.is_forced(id, &key);
            match look_up(key, is_forced, self.store)? {
                State::Hit(key, entry) => {
                    self.take_hit(id, &key, entry);
                    has_hits = true;
                }
                State::Stale(key, _) => {
                    let inputs = self.inputs(id);
                    self.running.insert(id, key.digest);
                    self.status[id] = Status::Running;
                    jobs.push(Job { id, node: &self.order.graph.nodes[id], key, inputs, _lock: lock });
                }
                State::Waiting(_) => {}
            }
        }
        Ok((jobs, has_hits))
    }

    fn inputs(&self, id: NodeId) -> Vec<(&'static str, Vec<(NodeId, Entry)>)> {
        let entry = |source: &NodeId| match &self.status[*source] {
            Status::Done(entry) => Some((*source, (**entry).clone())),
            _ => None,
        };
        let node = &self.order.graph.nodes[id];
        node.inputs.iter().map(|(port, sources)| (port.name, sources.iter().filter_map(entry).collect())).collect()
    }

    /// Tells that a node begins. Only now is the manifest worth writing: until then a kill loses nothing.
    fn begin(&mut self, node: &Node) -> anyhow::Result<()> {
        if self.written.is_none() {
            self.write_manifest(false)?;
        }
        self.events.tell(&Event::NodeStarted {
            node: node.name.clone(),
            kind: node.kind.name.to_owned(),
            round: node.round,
            recording: Some(live_name(node)),
        });
        Ok(())
    }

    fn take_hit(&mut self, id: NodeId, key: &Key, entry: Box<Entry>) {
        let is_remade =
            self.made.contains(&key.digest) && self.ends.get(&id).is_some_and(|end| end.1 == NodeState::Ran);
        let state = if is_remade { NodeState::Ran } else { NodeState::Cached };
        self.finished(id, key.digest, entry, 0.0, state);
    }

    fn take_in(&mut self, id: NodeId, key: Key, ended: Ended, secs: f64) {
        self.running.remove(&id);
        let node = &self.order.graph.nodes[id];
        match ended {
            Ended::Published(published) => {
                self.made.insert(key.digest);
                if let Some(other) = published.differs {
                    let text = format!(
                        "`{}` is not deterministic: the same key made {} and now {}",
                        node.kind.name,
                        published.entry.output.short(),
                        other.short()
                    );
                    self.events.warn(Some(&node.name), text);
                }
                self.finished(id, key.digest, Box::new(published.entry), secs, NodeState::Ran);
            }
            Ended::Failed(failure) => {
                self.tell_finished(id, secs, NodeState::Failed, None, Some(failure.text.clone()));
                self.note(id, key.digest, secs, NodeState::Failed, None);
                self.status[id] = Status::Failed(failure);
            }
            Ended::Stopped => {
                self.tell_finished(id, secs, NodeState::Stopped, None, None);
                self.note(id, key.digest, secs, NodeState::Stopped, None);
                self.status[id] = Status::Stopped;
            }
            Ended::Damaged { maker, what } => self.make_again(id, &key, maker, &what),
        }
    }

    /// Sends the maker of a damaged output to work again, and its taker back to wait.
    fn make_again(&mut self, taker: NodeId, key: &Key, maker: NodeId, what: &str) {
        let name = &self.order.graph.nodes[maker].name;
        let repairs = self.repairs.entry(maker).or_default();
        *repairs += 1;
        if *repairs > REPAIRS {
            let text = format!("the output of {name} is damaged again and again: {what}");
            self.tell_finished(taker, 0.0, NodeState::Failed, None, Some(text.clone()));
            self.note(taker, key.digest, 0.0, NodeState::Failed, None);
            self.status[taker] = Status::Failed(Failure { text, is_store: true });
            return;
        }
        self.events.warn(Some(name), format!("the output of {name} cannot be used: {what}; making it again"));
        if matches!(self.status[maker], Status::Done(_)) {
            self.status[maker] = Status::Waiting;
        }
        // Whatever takes it has to wait, since it may come out otherwise.
        for (id, node) in self.order.graph.nodes.iter().enumerate() {
            let takes_it = node.inputs.iter().any(|(_, sources)| sources.contains(&maker));
            if id == taker || (takes_it && matches!(self.status[id], Status::Ready(_))) {
                self.status[id] = Status::Waiting;
            }
        }
    }

    fn finished(&mut self, id: NodeId, key: Digest, entry: Box<Entry>, secs: f64, state: NodeState) {
        let name = &self.order.graph.nodes[id].name;
        if entry.lost_recording {
            let text = format!("the recording of {name} is gone; `carl-pipe run --force={name}` makes it again");
            self.events.warn(Some(name), text);
        }
        let recorded = entry.recording.as_ref().map(|recording| recording.object);
        let recording = recorded.and_then(|object| self.link(name, link_name(name), object));
        // Only where results are read off: a link costs as much as the rest of a cached node.
        for file in entry.files.iter().filter(|_| self.order.graph.nodes[id].is_last) {
            self.link(name, format!("{}.{}", file_name(name), file_name(&file.name)), file.object);
        }
        self.tell_finished(id, secs, state, Some((&entry, recording)), None);
        self.note(id, key, secs, state, Some(&entry));
        self.status[id] = Status::Done(entry);
        if self.written.is_some_and(|written| written.elapsed() > MANIFEST_EVERY)
            && let Err(error) = self.write_manifest(false)
        {
            self.events.warn(None, format!("{error:#}"));
        }
    }

    fn tell_waiting(&mut self, id: NodeId) {
        if self.elsewhere.insert(id) {
            let node = self.order.graph.nodes[id].name.clone();
            self.events
                .tell(&Event::Say { node, text: "another process works on it; waiting for its result".to_owned() });
        }
    }

    /// Gives an object a name in the folder of the run, where that can be done.
    fn link(&self, node: &str, name: String, object: Digest) -> Option<String> {
        match self.dir.link(&name, object) {
            Ok(()) => Some(name),
            Err(error) => {
                self.events.warn(Some(node), format!("{error:#}"));
                None
            }
        }
    }

    fn tell_finished(
        &self,
        id: NodeId,
        secs: f64,
        state: NodeState,
        output: Option<(&Entry, Option<String>)>,
        error: Option<String>,
    ) {
        let node = &self.order.graph.nodes[id];
        self.events.tell(&Event::NodeFinished {
            node: node.name.clone(),
            kind: node.kind.name.to_owned(),
            round: node.round,
            state,
            secs,
            digest: output.as_ref().map(|(entry, _)| entry.output),
            metrics: output.as_ref().map_or_else(BTreeMap::new, |(entry, _)| entry.metrics.clone()),
            recording: output.and_then(|(_, recording)| recording),
            error,
        });
    }

    /// Notes in the manifest what became of a node.
    fn note(&mut self, id: NodeId, key: Digest, secs: f64, state: NodeState, entry: Option<&Entry>) {
        self.ends.insert(id, (secs, state));
        let record = &mut self.manifest.nodes[self.row[&id]];
        (record.key, record.state) = (Some(key), state);
        self.manifest.node_secs += secs;
        if let Some(entry) = entry {
            record.output = Some(entry.output);
            record.recording = entry.recording.as_ref().map(|recording| recording.messages);
            record.metrics.clone_from(&entry.metrics);
            (record.secs, record.recorder_secs) = (entry.secs, entry.recorder_secs);
            if state == NodeState::Ran {
                self.manifest.recorder_secs += entry.recorder_secs;
            }
        }
    }

    fn write_manifest(&mut self, durable: bool) -> anyhow::Result<()> {
        self.manifest.wall_secs = self.events.elapsed_secs();
        self.manifest.write(&self.dir.path, durable)?;
        self.written = Some(Instant::now());
        Ok(())
    }

    /// Writes down what became of everything.
    fn finish(mut self) -> anyhow::Result<Report> {
        self.manifest.state = self.state();
        // A run that made nothing has nothing that a power cut could take.
        self.write_manifest(self.written.is_some())?;
        let nodes = self.row.iter().map(|(&id, &row)| {
            let record = &self.manifest.nodes[row];
            NodeReport {
                name: record.name.clone(),
                stage: record.stage.clone(),
                round: record.round,
                state: record.state,
                secs: self.ends.get(&id).map_or(0.0, |end| end.0),
                digest: record.output,
                recording: record.recording,
                metrics: record.metrics.clone(),
                failure: if let Status::Failed(failure) = &self.status[id] { Some(failure.clone()) } else { None },
            }
        });
        let report = Report {
            run: self.dir.id.clone(),
            path: self.dir.path.clone(),
            state: self.manifest.state,
            nodes: nodes.collect(),
            wall_secs: self.events.elapsed_secs(),
        };
        self.events.tell(&Event::RunFinished {
            state: report.state,
            executed: report.count(NodeState::Ran),
            cached: report.count(NodeState::Cached),
            failed: report.count(NodeState::Failed),
            wall_secs: report.wall_secs,
        });
        Ok(report)
    }

    fn state(&self) -> RunState {
        let any = |test: fn(&Status) -> bool| self.status.iter().any(test);
        if any(|status| matches!(status, Status::Failed(_))) {
            RunState::Failed
        } else if any(|status| !matches!(status, Status::Done(_) | Status::NotWanted)) {
            RunState::Interrupted
        } else {
            RunState::Finished
        }
    }
}
