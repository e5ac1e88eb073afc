//! Passes on what a running stage reports, progress at most a few times a second.

use std::{
    collections::BTreeMap,
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicBool, AtomicU64, Ordering},
    },
};

use crate::{
    run::events::{Event, Events},
    stage::Host,
};

/// The least time between two progress events of a node, in milliseconds.
const PROGRESS_EVERY_MS: u64 = 200;

/// The host of the stage of one node.
pub(super) struct NodeHost<'a> {
    node: &'a str,
    round: Option<u32>,
    events: &'a Events<'a>,
    stop: &'a AtomicBool,
    next_progress_ms: AtomicU64,
    metrics: Mutex<BTreeMap<String, f64>>,
}

impl<'a> NodeHost<'a> {
    pub(super) fn new(node: &'a str, round: Option<u32>, events: &'a Events<'a>, stop: &'a AtomicBool) -> Self {
        Self { node, round, events, stop, next_progress_ms: AtomicU64::new(0), metrics: Mutex::default() }
    }

    /// The metrics that the stage reported, the last value of each.
    pub(super) fn into_metrics(self) -> BTreeMap<String, f64> {
        self.metrics.into_inner().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Host for NodeHost<'_> {
    fn progress(&self, done: u64, total: u64, note: &str) {
        let now_ms = (self.events.elapsed_secs() * 1e3) as u64;
        let due_ms = self.next_progress_ms.load(Ordering::Relaxed);
        if now_ms < due_ms && done != total {
            return;
        }
        self.next_progress_ms.store(now_ms + PROGRESS_EVERY_MS, Ordering::Relaxed);
        self.events.emit(&Event::Progress { node: self.node.to_owned(), done, total, note: note.to_owned() });
    }

    fn metric(&self, name: &str, value: f64) {
        if !value.is_finite() {
            self.events.warn(Some(self.node), format!("metric `{name}` is {value} and is left out"));
            return;
        }
        self.metrics.lock().unwrap_or_else(PoisonError::into_inner).insert(name.to_owned(), value);
        let (node, round) = (self.node.to_owned(), self.round);
        self.events.emit(&Event::Metric { node, round, name: name.to_owned(), value });
    }

    fn say(&self, text: &str) {
        self.events.emit(&Event::Say { node: self.node.to_owned(), text: text.to_owned() });
    }

    fn stop_asked(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}
