//! What a stage may use while it works: named random streams, its recording, progress, its saved state and its share of
//! the cores.

use std::path::PathBuf;

use anyhow::bail;

use super::{StageState, probe::MapProbe};
use crate::{
    artifact::Files,
    digest::Digest,
    env::Task,
    num::{
        Threads,
        rng::{Purpose, Rng, Stream},
    },
    record::{At, Level, Recorder},
};

/// The program around a running stage. Nothing that a host answers changes a result.
pub trait Host: Sync {
    /// `done` of `total` steps; `note` is a few words such as `loss 17.2`.
    fn progress(&self, done: u64, total: u64, note: &str);
    /// A metric of the node, shown in the closing table and kept with its result.
    fn metric(&self, name: &str, value: f64);
    /// A sentence for the user.
    fn say(&self, text: &str);
    /// True once the user asked to stop.
    fn stop_asked(&self) -> bool;

    /// The files of a state that an earlier process saved for this node.
    fn saved_state(&self) -> Option<Files> {
        None
    }

    /// An empty folder for this node alone, in the file system of the store. It goes away once the output is published.
    ///
    /// # Errors
    /// There is none here.
    fn folder(&self) -> anyhow::Result<PathBuf> {
        bail!("a stage has no folder here")
    }

    /// The file with this content, among those that the parameters name.
    ///
    /// # Errors
    /// The file has changed since the run was planned, or cannot be read.
    fn file(&self, content: Digest) -> anyhow::Result<PathBuf> {
        bail!("the file {} cannot be read here", content.short())
    }

    /// Called at every tick of a stage that can be resumed. A host that wants the state now calls `save`.
    fn offer_state(&self, _save: &dyn Fn() -> anyhow::Result<Files>) {}
}

/// The user pressed Ctrl-C, and the stage stopped at a tick. The node publishes nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Interrupted;

impl std::fmt::Display for Interrupted {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("interrupted")
    }
}

impl std::error::Error for Interrupted {}

/// The context of one node while it runs.
pub struct StageCx<'a> {
    /// The node's recording; it never fails and never changes a result.
    pub record: &'a mut Recorder,
    /// The task of the pipeline.
    pub task: &'a Task,
    /// The node's share of the cores; may change while it works.
    pub threads: Threads,
    /// The round of the loop; 0 outside of one.
    pub round: u32,
    stream: Stream,
    host: &'a dyn Host,
    /// Names of reported metrics that were not finite.
    not_finite: Vec<String>,
}

impl std::fmt::Debug for StageCx<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("StageCx").field("round", &self.round).field("stream", &self.stream).finish_non_exhaustive()
    }
}

impl<'a> StageCx<'a> {
    /// The context of a node.
    pub fn new(
        record: &'a mut Recorder,
        task: &'a Task,
        stream: Stream,
        round: u32,
        threads: Threads,
        host: &'a dyn Host,
    ) -> Self {
        Self { record, task, threads, round, stream, host, not_finite: Vec::new() }
    }

    /// A random stream for one purpose, such as `"init"` or `("batches", epoch)`. Draws for one purpose never shift the
    /// draws for another.
    pub fn rng(&self, purpose: impl Into<Purpose>) -> Rng {
        self.stream.rng(purpose.into())
    }

    /// A random stream that every round, algorithm and stage with the same seed shares, such as `"episodes"`.
    pub fn shared_rng(&self, purpose: impl Into<Purpose>) -> Rng {
        self.stream.shared(purpose.into())
    }

    /// A probe that records the latent map of known states. The stage itself never gets the states.
    pub fn map_probe(&self) -> MapProbe {
        MapProbe::new(self.task)
    }

    /// The saved state of this node, or a fresh one.
    ///
    /// # Errors
    /// Those of `fresh`. A saved state that cannot be read is reported to the user, and the stage starts afresh.
    pub fn resume_or<S: StageState>(&self, fresh: impl FnOnce() -> anyhow::Result<S>) -> anyhow::Result<S> {
        match self.host.saved_state().as_ref().map(S::load) {
            Some(Ok(state)) => Ok(state),
            Some(Err(error)) => {
                self.say(&format!("the saved state cannot be read, so the stage starts afresh: {error:#}"));
                fresh()
            }
            None => fresh(),
        }
    }

    /// Reports progress, and offers the host the state. Nothing is written unless the host asks for it.
    ///
    /// # Errors
    /// [`Interrupted`] once the user asked to stop: pass it on with `?`.
    pub fn tick<S: StageState>(&mut self, done: u64, total: u64, note: &str, state: &S) -> Result<(), Interrupted> {
        self.host.offer_state(&|| state.save());
        self.progress(done, total, note)
    }

    /// Reports progress of a stage that starts afresh after a stop.
    ///
    /// # Errors
    /// [`Interrupted`] once the user asked to stop: pass it on with `?`.
    pub fn progress(&mut self, done: u64, total: u64, note: &str) -> Result<(), Interrupted> {
        self.host.progress(done, total, note);
        self.say_log();
        if self.host.stop_asked() { Err(Interrupted) } else { Ok(()) }
    }

    /// Shows progress in a stage that asks [`StageCx::stop_asked`] by itself.
    pub(super) fn show_progress(&self, done: u64, total: u64, note: &str) {
        self.host.progress(done, total, note);
    }

    /// True once the user asked to stop.
    pub(super) fn stop_asked(&self) -> bool {
        self.host.stop_asked()
    }

    /// See [`Host::folder`].
    ///
    /// # Errors
    /// There is none here.
    pub(super) fn folder(&self) -> anyhow::Result<PathBuf> {
        self.host.folder()
    }

    /// See [`Host::file`].
    ///
    /// # Errors
    /// The file has changed since the run was planned, or cannot be read.
    pub(super) fn file(&self, content: Digest) -> anyhow::Result<PathBuf> {
        self.host.file(content)
    }

    /// Reports a metric, such as `percent_goal`. A stage whose headline is not finite fails.
    pub fn metric(&mut self, name: &str, value: f64) {
        if !value.is_finite() {
            self.not_finite.push(name.to_owned());
        }
        self.host.metric(name, value);
    }

    /// Whether a metric was reported with a value that is not finite.
    pub(super) fn is_not_finite(&self, metric: &str) -> bool {
        self.not_finite.iter().any(|name| name == metric)
    }

    /// Shows the user what the task's program wrote to standard error.
    pub fn say_log(&self) {
        self.task.take_log().iter().for_each(|line| self.say(line));
    }

    /// Shows the user a sentence.
    pub fn say(&self, text: &str) {
        self.host.say(text);
    }

    /// Shows the user a sentence and writes it into the recording.
    pub fn log(&mut self, at: At, level: Level, text: &str) {
        self.record.log(at, level, text);
        self.say(text);
    }
}
