//! Where one node of a run stands.

#![allow(clippy::disallowed_methods, reason = "a clock spaces questions to the system; no key or result holds a time")]

use std::time::{Duration, Instant};

use crate::{
    digest::Digest,
    run::{events::NodeState, execute::Failure},
    store::{Entry, Holder, KeyLock},
};

/// The least time between two questions about who holds a lock.
const ASK_EVERY: Duration = Duration::from_secs(5);

/// What the user was told about another process that works on a node's key.
#[derive(Debug, Default)]
pub(super) struct Waiting {
    asked: Option<Instant>,
    /// Whether the process was stopped when the user was last told.
    said_stopped: Option<bool>,
}

impl Waiting {
    /// Whether it is time to ask who holds the lock.
    pub(super) fn is_due(&mut self) -> bool {
        let is_due = self.asked.is_none_or(|asked| asked.elapsed() > ASK_EVERY);
        if is_due {
            self.asked = Some(Instant::now());
        }
        is_due
    }

    /// Whether the user does not know this about the holder yet.
    pub(super) fn is_news(&mut self, holder: Option<Holder>) -> bool {
        let now = Some(holder.is_some_and(|holder| holder.is_stopped));
        std::mem::replace(&mut self.said_stopped, now) != now
    }
}

/// A wanted node in a run.
#[derive(Debug)]
pub(super) struct NodeRun {
    /// Where it stands.
    pub(super) phase: Phase,
    /// Its row in the manifest.
    pub(super) row: usize,
    /// Seconds that it worked in this run.
    pub(super) worked_secs: f64,
    /// Whether it made an output in this run.
    pub(super) has_run: bool,
    /// How often its output was found damaged in this run.
    repairs: u32,
    /// What the user was told about a process that works on its key.
    pub(super) waiting: Waiting,
}

/// Where a wanted node stands.
#[derive(Debug)]
pub(super) enum Phase {
    /// An input is missing.
    Waiting,
    /// All inputs are there. It starts as soon as there is room, and no other process works on its key.
    Ready(Digest),
    /// It works. The lock keeps other processes from working on the same key.
    Running { key: Digest, _lock: Box<dyn KeyLock> },
    /// Its output is in the store.
    Done(Box<Entry>),
    /// It failed.
    Failed(Failure),
    /// The user stopped it.
    Stopped,
}

impl NodeRun {
    /// A node that waits.
    pub(super) fn new(row: usize) -> Self {
        Self { phase: Phase::Waiting, row, worked_secs: 0.0, has_run: false, repairs: 0, waiting: Waiting::default() }
    }

    /// The entry of its output.
    pub(super) fn entry(&self) -> Option<&Entry> {
        if let Phase::Done(entry) = &self.phase { Some(entry) } else { None }
    }

    /// Why it failed.
    pub(super) fn failure(&self) -> Option<&Failure> {
        if let Phase::Failed(failure) = &self.phase { Some(failure) } else { None }
    }

    /// Counts that its output was found damaged; returns how often it was.
    pub(super) fn count_repair(&mut self) -> u32 {
        self.repairs += 1;
        self.repairs
    }

    /// The state that events and manifests show for a node that ended without an output.
    pub(super) fn state_without_output(&self) -> NodeState {
        match self.phase {
            Phase::Failed(_) => NodeState::Failed,
            Phase::Stopped => NodeState::Stopped,
            _ => NodeState::Pending,
        }
    }
}
