//! What a stage may touch while it works: named random streams, its recording, progress and its share of the cores.

use super::probe::MapProbe;
use crate::{
    env::Task,
    num::{
        Threads,
        rng::{Purpose, Rng, Stream},
    },
    record::Recorder,
};

/// What the engine hears of a running stage. Nothing a host answers reaches a result.
pub trait Host: Sync {
    /// `done` of `total` steps; `note` is a few words such as `loss 17.2`.
    fn progress(&self, done: u64, total: u64, note: &str);
    /// A metric of the node, shown in the closing table and kept with its result.
    fn metric(&self, name: &str, value: f64);
    /// A sentence for the user.
    fn say(&self, text: &str);
    /// True once the user asked to stop.
    fn stop_asked(&self) -> bool;
}

/// Ctrl-C, seen at a tick: the node publishes nothing and the same command goes on from what is finished.
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
        Self { record, task, threads, round, stream, host }
    }

    /// A random stream for one purpose, such as `"init"` or `("batches", epoch)`: draws for one purpose never shift
    /// those for another.
    pub fn rng(&self, purpose: impl Into<Purpose>) -> Rng {
        self.stream.rng(purpose.into())
    }

    /// A random stream that every round, algorithm and stage with the same seed shares, such as `"episodes"`.
    pub fn shared_rng(&self, purpose: impl Into<Purpose>) -> Rng {
        self.stream.shared(purpose.into())
    }

    /// A probe that records latent maps of known states without showing the states.
    pub fn map_probe(&self) -> MapProbe {
        MapProbe::new(self.task)
    }

    /// Reports progress.
    ///
    /// # Errors
    /// [`Interrupted`] once the user asked to stop: pass it on with `?`.
    pub fn tick(&mut self, done: u64, total: u64, note: &str) -> Result<(), Interrupted> {
        self.host.progress(done, total, note);
        if self.host.stop_asked() { Err(Interrupted) } else { Ok(()) }
    }

    /// Reports a metric, such as `percent_goal`.
    pub fn metric(&mut self, name: &str, value: f64) {
        self.host.metric(name, value);
    }

    /// Tells the user something, such as a detector that fired.
    pub fn say(&self, text: &str) {
        self.host.say(text);
    }
}
