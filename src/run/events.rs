//! The events of a run, in the order in which they happen. Progress bars, `--json` and the live view read them.

#![allow(clippy::disallowed_methods, reason = "an event says when it happened; no key or result holds a time")]

use std::{
    collections::BTreeMap,
    fs::{File, OpenOptions},
    io::{self, Write as _},
    path::Path,
    sync::Mutex,
    time::Instant,
};

use anyhow::Context as _;
use serde::{Deserialize, Serialize};

use crate::{digest::Digest, failpoint::failpoint};

/// One line of `events.jsonl`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "event", rename_all = "snake_case")]
pub enum Event {
    /// The first event of a run.
    RunStarted {
        /// The id of the run.
        #[serde(default)]
        run: String,
        /// The number of the run; see [`super::manifest::Manifest::number`].
        #[serde(default, skip_serializing_if = "Option::is_none")]
        number: Option<u64>,
        /// The name of the pipeline.
        pipeline: String,
        /// The seed, if all nodes have the same.
        seed: Option<u64>,
        /// How many nodes are wanted.
        #[serde(default)]
        nodes: usize,
    },
    /// A node started to work.
    NodeStarted {
        /// The name of the node.
        node: String,
        /// The kind of stage.
        #[serde(default)]
        kind: String,
        /// The round of the node.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        round: Option<u32>,
        /// Where the recording grows, below the folder of the run.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        recording: Option<String>,
    },
    /// How far a node has come; at most a few times a second.
    Progress {
        /// The name of the node.
        node: String,
        /// Steps done.
        done: u64,
        /// Steps in all.
        total: u64,
        /// A few words such as `loss 17.2`.
        note: String,
    },
    /// A metric of a node.
    #[serde(rename = "figure")]
    Metric {
        /// The name of the node.
        node: String,
        /// The round of the node.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        round: Option<u32>,
        /// The name of the metric.
        name: String,
        /// Its value.
        value: f64,
    },
    /// A node says something to the user.
    Say {
        /// The name of the node.
        node: String,
        /// The sentence.
        text: String,
    },
    /// Something went wrong, but the run continues.
    Warning {
        /// The node, if it is about one.
        node: Option<String>,
        /// What went wrong.
        text: String,
    },
    /// A node ended, or its output was found in the store.
    NodeFinished {
        /// The name of the node.
        node: String,
        /// The kind of stage.
        #[serde(default)]
        kind: String,
        /// The round of the node.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        round: Option<u32>,
        /// How it ended.
        state: NodeState,
        /// Seconds that it worked in this run.
        #[serde(default)]
        secs: f64,
        /// The content digest of its output.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        digest: Option<Digest>,
        /// The finished recording, as seen from the folder of the run.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        recording: Option<String>,
        /// Its metrics.
        #[serde(rename = "figures", default)]
        metrics: BTreeMap<String, f64>,
        /// What went wrong, with every cause.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        error: Option<String>,
    },
    /// The last event of a run.
    RunFinished {
        /// How it ended.
        state: RunState,
        /// Nodes that worked.
        executed: usize,
        /// Nodes found in the store.
        cached: usize,
        /// Nodes that failed.
        failed: usize,
        /// Seconds from start to end.
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
    /// It failed; nothing is published.
    Failed,
    /// The user stopped it; nothing is published.
    Stopped,
    /// It did not start.
    Pending,
}

/// How a run ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RunState {
    /// It has not ended, or its process was killed.
    Running,
    /// Every wanted node has its output.
    Finished,
    /// A node failed.
    Failed,
    /// The user stopped it.
    Interrupted,
}

/// Gets every event, in the thread in which it happened.
pub trait Listener: Sync {
    /// Takes an event.
    fn on_event(&self, event: &Event);
}

/// Ignores every event.
impl Listener for () {
    fn on_event(&self, _event: &Event) {}
}

/// Writes events to `events.jsonl` and passes them on to a listener.
pub struct Events<'a> {
    start: Instant,
    file: Mutex<Lines>,
    listener: &'a dyn Listener,
}

/// The lines of `events.jsonl`.
struct Lines {
    /// `None` once a write has failed.
    file: Option<File>,
    /// Lines that wait for the next write.
    unwritten: Vec<u8>,
}

impl Lines {
    /// Adds a line. It is written at once, with the lines that waited, unless it may wait for the next line. A write holds
    /// whole lines: then a reader sees half a line only if the disk is full.
    fn add(&mut self, line: &[u8], may_wait: bool) -> io::Result<()> {
        self.unwritten.extend_from_slice(line);
        if may_wait && self.unwritten.len() < 1 << 16 {
            return Ok(());
        }
        let written =
            self.file.as_mut().map_or(Ok(()), |file| failpoint!("write events", file.write_all(&self.unwritten)));
        self.unwritten.clear();
        if written.is_err() {
            self.file = None;
        }
        written
    }
}

impl std::fmt::Debug for Events<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Events")
    }
}

impl<'a> Events<'a> {
    /// Starts `events.jsonl` in the folder of a run.
    ///
    /// # Errors
    /// The file exists already, or cannot be made.
    pub fn create(run_dir: &Path, listener: &'a dyn Listener) -> anyhow::Result<Self> {
        let path = run_dir.join("events.jsonl");
        let file = failpoint!("open events", OpenOptions::new().append(true).create_new(true).open(&path));
        let file = file.with_context(|| format!("cannot write {}", path.display()))?;
        Ok(Self {
            start: Instant::now(),
            file: Mutex::new(Lines { file: Some(file), unwritten: Vec::new() }),
            listener,
        })
    }

    /// Writes an event and passes it on.
    pub fn emit(&self, event: &Event) {
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
            let mut lines = self.file.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
            let may_wait = matches!(event, Event::NodeFinished { state: NodeState::Cached, .. });
            if let Err(error) = lines.add(line.as_bytes(), may_wait) {
                failure = Some(format!("cannot write events.jsonl, so the live view ends here: {error}"));
            }
        }
        self.listener.on_event(event);
        if let Some(text) = failure {
            self.listener.on_event(&Event::Warning { node: None, text });
        }
    }

    /// Emits a warning.
    pub fn warn(&self, node: Option<&str>, text: impl Into<String>) {
        self.emit(&Event::Warning { node: node.map(str::to_owned), text: text.into() });
    }

    /// Seconds since the start of the run.
    pub fn elapsed_secs(&self) -> f64 {
        self.start.elapsed().as_secs_f64()
    }
}
