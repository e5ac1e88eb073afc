//! Passes on what a running stage reports, progress at most a few times a second.

use std::{
    collections::BTreeMap,
    fs,
    path::PathBuf,
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicBool, AtomicU64, Ordering},
    },
};

use anyhow::Context as _;

use crate::{
    digest::Digest,
    run::{
        events::{Event, Events},
        named_files::NamedFiles,
    },
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
    files: NamedFiles<'a>,
    /// Where the folder of the node is made when it is asked for.
    folder: PathBuf,
}

impl<'a> NodeHost<'a> {
    pub(super) fn new(
        (node, round): (&'a str, Option<u32>),
        events: &'a Events<'a>,
        stop: &'a AtomicBool,
        files: NamedFiles<'a>,
        folder: PathBuf,
    ) -> Self {
        let (next_progress_ms, metrics) = (AtomicU64::new(0), Mutex::default());
        Self { node, round, events, stop, next_progress_ms, metrics, files, folder }
    }

    /// The metrics that the stage reported, the last value of each.
    pub(super) fn metrics(&self) -> BTreeMap<String, f64> {
        self.metrics.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

impl Drop for NodeHost<'_> {
    fn drop(&mut self) {
        // A stage without a folder has none to remove. What cannot be removed is swept when the store is opened next.
        _ = fs::remove_dir_all(&self.folder);
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

    fn folder(&self) -> anyhow::Result<PathBuf> {
        let made = fs::create_dir(&self.folder).and_then(|()| fs::canonicalize(&self.folder));
        made.with_context(|| format!("cannot make {}", self.folder.display()))
    }

    fn file(&self, content: Digest) -> anyhow::Result<PathBuf> {
        self.files.verified(content)
    }
}
