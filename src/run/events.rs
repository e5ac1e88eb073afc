//! What happens in a run, as it happens: one stream that progress bars, `--json` and the live view all read.

#![allow(
    clippy::disallowed_methods,
    reason = "wall times are kept beside a run and name its folder; no key and no result holds one"
)]

use std::{
    collections::BTreeMap,
    fs::{File, OpenOptions},
    io::Write as _,
    path::Path,
    sync::Mutex,
    time::Instant,
};

use anyhow::Context as _;
use serde::{Deserialize, Serialize};

use crate::digest::Digest;

/// One line of `events.jsonl`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "event", rename_all = "snake_case")]
pub enum Event {
    /// The first event of a run.
    RunStarted {
        /// The run's id.
        run: String,
        /// The pipeline's name.
        pipeline: String,
        /// The seed, where all nodes have the same.
        seed: Option<u64>,
        /// How many nodes are wanted.
        nodes: usize,
    },
    /// A node began to work.
    NodeStarted {
        /// Which.
        node: String,
        /// What it does.
        kind: String,
        /// Its round.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        round: Option<u32>,
        /// Where its recording grows, below the folder of the run.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        recording: Option<String>,
    },
    /// How far a node is; at most a few times a second.
    Progress {
        /// Which.
        node: String,
        /// Steps done.
        done: u64,
        /// Of how many.
        total: u64,
        /// A few words such as `loss 17.2`.
        note: String,
    },
    /// A metric of a node.
    #[serde(rename = "figure")]
    Metric {
        /// Which.
        node: String,
        /// Its round.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        round: Option<u32>,
        /// Of what.
        name: String,
        /// How much.
        value: f64,
    },
    /// A sentence from a node.
    Say {
        /// Which.
        node: String,
        /// The sentence.
        text: String,
    },
    /// Something went wrong that stops nothing.
    Warning {
        /// Where, if in a node.
        node: Option<String>,
        /// What.
        text: String,
    },
    /// A node came to its end, or was found in the store.
    NodeFinished {
        /// Which.
        node: String,
        /// What it does.
        kind: String,
        /// Its round.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        round: Option<u32>,
        /// How it ended.
        state: NodeState,
        /// How long it worked in this run.
        secs: f64,
        /// The content digest of its output.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        digest: Option<Digest>,
        /// Its recording, below the folder of the run.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        recording: Option<String>,
        /// Its metrics.
        #[serde(rename = "figures")]
        metrics: BTreeMap<String, f64>,
        /// What went wrong, with every cause.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        error: Option<String>,
    },
    /// The last event of a run.
    RunFinished {
        /// How it ended.
        state: RunState,
        /// Nodes that ran.
        executed: usize,
        /// Nodes found in the store.
        cached: usize,
        /// Nodes that failed.
        failed: usize,
        /// From start to end.
        wall_secs: f64,
    },
}

/// How a node ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum NodeState {
    /// It worked and its output is published.
    Ran,
    /// The store had its output.
    Cached,
    /// It went wrong; nothing is published.
    Failed,
    /// The user stopped it; nothing is published.
    Stopped,
    /// Its turn never came.
    Pending,
}

/// How a run ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RunState {
    /// It has not; or its process was killed.
    Running,
    /// Every wanted node has its output.
    Finished,
    /// A node failed.
    Failed,
    /// The user stopped it.
    Interrupted,
}

/// Someone who hears every event; called from the thread in which it happened.
pub trait Listener: Sync {
    /// Hears of an event.
    fn hear(&self, event: &Event);
}

/// Nobody listens.
impl Listener for () {
    fn hear(&self, _event: &Event) {}
}

/// Appends events to `events.jsonl` and passes them on.
pub struct Events<'a> {
    start: Instant,
    file: Mutex<Option<File>>,
    listener: &'a dyn Listener,
}

impl std::fmt::Debug for Events<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Events")
    }
}

impl<'a> Events<'a> {
    /// A new stream in the folder of a run.
    pub(crate) fn create(run_dir: &Path, listener: &'a dyn Listener) -> anyhow::Result<Self> {
        let path = run_dir.join("events.jsonl");
        let file = OpenOptions::new().append(true).create_new(true).open(&path);
        let file = file.with_context(|| format!("cannot write {}", path.display()))?;
        Ok(Self { start: Instant::now(), file: Mutex::new(Some(file)), listener })
    }

    /// Tells everybody.
    pub fn tell(&self, event: &Event) {
        #[derive(Serialize)]
        struct Line<'a> {
            #[serde(flatten)]
            event: &'a Event,
            /// Seconds since the start of the run.
            at: f64,
        }
        let at = (self.start.elapsed().as_secs_f64() * 1e3).round() / 1e3;
        let mut failure = None;
        if let Ok(mut line) = serde_json::to_string(&Line { event, at }) {
            line.push('\n');
            let mut file = self.file.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
            // One write per line, so that a reader never meets half of one that was not torn by a full disk.
            if let Some(Err(error)) = file.as_mut().map(|file| file.write_all(line.as_bytes())) {
                *file = None;
                failure = Some(format!("cannot write events.jsonl, so the live view ends here: {error}"));
            }
        }
        self.listener.hear(event);
        if let Some(text) = failure {
            self.listener.hear(&Event::Warning { node: None, text });
        }
    }

    /// Tells of something that stops nothing.
    pub fn warn(&self, node: Option<&str>, text: impl Into<String>) {
        self.tell(&Event::Warning { node: node.map(str::to_owned), text: text.into() });
    }

    /// Seconds since the start of the run.
    pub fn elapsed_secs(&self) -> f64 {
        self.start.elapsed().as_secs_f64()
    }
}
