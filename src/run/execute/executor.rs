//! The contract between the scheduler, which decides what works next, and an executor, which gets the work done.

use std::time::Duration;

use crate::{digest::Digest, pipeline::NodeId, run::job::Job, store::Published};

/// Gets jobs done, in threads of this process or elsewhere.
///
/// Doing a job twice is harmless: the first result that is published counts. The scheduler holds the lock of a job's
/// key from the start of the job until its outcome is taken in.
pub trait Executor {
    /// Starts a job and returns at once; its outcome comes out of [`Executor::wait`].
    ///
    /// # Errors
    /// The job cannot be started.
    fn start(&mut self, id: NodeId, job: Job) -> anyhow::Result<()>;

    /// Waits for the outcome of any started job; `None` if there is none within `patience`.
    fn wait(&mut self, patience: Duration) -> Option<Finished>;
}

/// A job that has ended.
#[derive(Debug)]
pub struct Finished {
    /// The node that it was started for.
    pub id: NodeId,
    /// How it ended.
    pub outcome: JobOutcome,
    /// Seconds that it worked.
    pub secs: f64,
}

/// How a job ended.
#[derive(Debug)]
pub enum JobOutcome {
    /// Its result is published.
    Published(Box<Published>),
    /// It failed. Nothing is published.
    Failed(Failure),
    /// The user stopped it. Nothing is published.
    Stopped,
    /// An input cannot be used, so its maker has to run again. Nothing is published.
    DamagedInput {
        /// The key that made the input.
        made_by: Digest,
        /// What is wrong with the input, such as `its model.safetensors is damaged`.
        problem: String,
    },
}

/// Why a node failed: a description with every cause.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Failure {
    /// The stage returned an error or panicked.
    Stage(String),
    /// The store or the system failed.
    System(String),
}

impl Failure {
    /// The failure of the store or the system behind an error.
    pub(super) fn of_system(error: &anyhow::Error) -> Self {
        Self::System(format!("{error:#}"))
    }

    /// The description.
    pub fn text(&self) -> &str {
        match self {
            Self::Stage(text) | Self::System(text) => text,
        }
    }
}
