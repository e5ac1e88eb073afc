//! Keeps what happens in a run: events, the manifest, and links to what nodes made.

#![allow(
    clippy::disallowed_methods,
    reason = "a clock spaces the writing of the manifest; no key or result holds a time"
)]

use std::{
    collections::BTreeSet,
    path::Path,
    time::{Duration, Instant},
};

use super::node_run::{NodeRun, Phase};
use crate::{
    digest::Digest,
    pipeline::Node,
    run::{
        events::{Event, Events, NodeState, RunState},
        execute::{
            NodeEnd, Report,
            recording::{link_name, live_name},
        },
        manifest::Manifest,
        runs::{RunDir, file_name},
    },
    store::{Entry, ResultStore},
};

/// How often a long run writes its manifest, so that a killed run shows what it had.
const MANIFEST_EVERY: Duration = Duration::from_secs(1);

/// A run of at most this many nodes links the files of cached nodes, too.
const LINKED_WHEN_CACHED: usize = 100;

/// The records of a run in progress.
pub(super) struct Journal<'a> {
    store: &'a dyn ResultStore,
    events: &'a Events<'a>,
    dir: &'a RunDir,
    manifest: Manifest,
    /// When the manifest was last written; `None` until a node starts to work.
    written: Option<Instant>,
    /// Whether `latest` was pointed to this run, or that was tried.
    is_latest: bool,
    /// The nodes that were found in the store without a recording.
    unrecorded: BTreeSet<String>,
    /// Whether the user was told that links fail.
    has_warned_of_links: bool,
}

impl<'a> Journal<'a> {
    pub(super) fn new(store: &'a dyn ResultStore, events: &'a Events<'a>, dir: &'a RunDir, manifest: Manifest) -> Self {
        let (unrecorded, has_warned_of_links) = (BTreeSet::new(), false);
        Self { store, events, dir, manifest, written: None, is_latest: false, unrecorded, has_warned_of_links }
    }

    /// Emits a sentence from a node.
    pub(super) fn say(&self, node: &str, text: &str) {
        self.events.emit(&Event::Say { node: node.to_owned(), text: text.to_owned() });
    }

    /// Warns of something about a node that stops nothing.
    pub(super) fn warn(&self, node: &str, text: String) {
        self.events.warn(Some(node), text);
    }

    /// Notes that a node starts to work. The first one writes the manifest: until then a kill loses nothing.
    pub(super) fn begin(&mut self, node: &Node) -> anyhow::Result<()> {
        if self.written.is_none() {
            self.write_manifest(false)?;
        }
        self.events.emit(&Event::NodeStarted {
            node: node.name.clone(),
            kind: node.kind.name.to_owned(),
            round: node.round,
            recording: Some(live_name(&node.name)),
        });
        Ok(())
    }

    /// Notes that a node has an output.
    pub(super) fn end_with(&mut self, node: &Node, run: &NodeRun, state: NodeState, entry: &Entry) {
        let name = &node.name;
        if entry.recording.is_none() && state == NodeState::Cached {
            self.unrecorded.insert(name.clone());
        } else {
            self.unrecorded.remove(name);
        }
        // A link costs as much as the rest of a cached node, so large runs link only what they made.
        let is_linked = state == NodeState::Ran || self.manifest.nodes.len() <= LINKED_WHEN_CACHED;
        let recorded = entry.recording.as_ref().and_then(|recording| self.store.path_of(recording.object));
        let recording = recorded.and_then(|object| match is_linked {
            true if self.link(&link_name(name), &object) => Some(link_name(name)),
            _ => self.dir.seen_from(&object).into_os_string().into_string().ok(),
        });
        // Only where results are read off.
        for file in entry.files.iter().filter(|_| is_linked && node.is_last) {
            if let Some(object) = self.store.path_of(file.object) {
                self.link(&format!("{}.{}", file_name(name), file_name(&file.name)), &object);
            }
        }
        let outcome = &mut self.manifest.nodes[run.row].outcome;
        outcome.end_with(state, entry);
        self.manifest.node_secs += run.worked_secs;
        if state == NodeState::Ran {
            self.manifest.recorder_secs += entry.recorder_secs;
        }
        self.emit_finished(node, run, recording);
        if self.written.is_some_and(|written| written.elapsed() > MANIFEST_EVERY)
            && let Err(error) = self.write_manifest(false)
        {
            self.events.warn(None, format!("{error:#}"));
        }
    }

    /// Notes that a node ended without an output.
    pub(super) fn end_without_output(&mut self, node: &Node, run: &NodeRun, key: Digest) {
        self.manifest.nodes[run.row].outcome.end_without_output(run.state_without_output(), key);
        self.manifest.node_secs += run.worked_secs;
        self.emit_finished(node, run, None);
    }

    fn emit_finished(&self, node: &Node, run: &NodeRun, recording: Option<String>) {
        let outcome = &self.manifest.nodes[run.row].outcome;
        self.events.emit(&Event::NodeFinished {
            node: node.name.clone(),
            kind: node.kind.name.to_owned(),
            round: node.round,
            state: outcome.state,
            secs: run.worked_secs,
            digest: outcome.output,
            recording,
            metrics: outcome.metrics.clone(),
            error: run.failure().map(|failure| failure.text().to_owned()),
        });
    }

    /// Gives an object a name in the folder of the run, where that is possible.
    ///
    /// Where one link fails the others do too, as on a file system without links, so one warning is enough.
    fn link(&mut self, name: &str, object: &Path) -> bool {
        let linked = self.dir.link(name, object);
        if let Err(error) = &linked
            && !std::mem::replace(&mut self.has_warned_of_links, true)
        {
            let help = "`carl-pipe show RUN NODE` prints the paths of files";
            self.events.warn(None, format!("{error:#}, and maybe others; {help}"));
        }
        linked.is_ok()
    }

    fn write_manifest(&mut self, durable: bool) -> anyhow::Result<()> {
        self.manifest.wall_secs = self.events.elapsed_secs();
        self.manifest.write(&self.dir.path, durable)?;
        // `latest` moves once the run can be read. A run without that link is still whole.
        if !std::mem::replace(&mut self.is_latest, true)
            && let Err(error) = self.dir.point_latest()
        {
            self.events.warn(None, format!("{error:#}; name this run by its id"));
        }
        self.written = Some(Instant::now());
        Ok(())
    }

    /// A cached node never runs again for its recording alone, so the user is told each time that it has none.
    fn warn_of_unrecorded(&self) {
        const REPAIR: &str = "`carl-pipe verify --repair`";
        match self.unrecorded.first() {
            None => {}
            Some(one) if self.unrecorded.len() == 1 => {
                self.warn(one, format!("its result is cached without a recording; {REPAIR} makes the recording again"));
            }
            Some(_) => {
                let count = self.unrecorded.len();
                self.events
                    .warn(None, format!("{count} cached nodes have no recording; {REPAIR} makes the recordings again"));
            }
        }
    }

    /// Writes the manifest a last time, and reports what became of every wanted node.
    pub(super) fn finish(mut self, nodes: &[Option<NodeRun>]) -> anyhow::Result<Report> {
        self.manifest.state = state(nodes);
        // A run in which no node worked has nothing that a power cut could take.
        self.write_manifest(self.written.is_some())?;
        self.warn_of_unrecorded();
        let end = |node: &NodeRun| NodeEnd { worked_secs: node.worked_secs, failure: node.failure().cloned() };
        let report = Report {
            run: self.dir.id.clone(),
            path: self.dir.path.clone(),
            state: self.manifest.state,
            manifest: self.manifest,
            ends: nodes.iter().flatten().map(end).collect(),
            wall_secs: self.events.elapsed_secs(),
        };
        self.events.emit(&Event::RunFinished {
            state: report.state,
            executed: report.count(NodeState::Ran),
            cached: report.count(NodeState::Cached),
            failed: report.count(NodeState::Failed),
            wall_secs: report.wall_secs,
        });
        Ok(report)
    }
}

fn state(nodes: &[Option<NodeRun>]) -> RunState {
    let any = |test: fn(&Phase) -> bool| nodes.iter().flatten().any(|node| test(&node.phase));
    if any(|phase| matches!(phase, Phase::Failed(_))) {
        RunState::Failed
    } else if any(|phase| !matches!(phase, Phase::Done(_))) {
        RunState::Interrupted
    } else {
        RunState::Finished
    }
}
