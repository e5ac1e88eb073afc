//! Executes jobs in threads of this process.

#![allow(clippy::disallowed_methods, reason = "a manifest says how long nodes worked; no key or result holds a time")]

use std::{
    panic::{AssertUnwindSafe, catch_unwind},
    sync::mpsc::{Receiver, Sender, channel},
    thread::Scope,
    time::{Duration, Instant},
};

use super::{
    executor::{Executor, Failure, Finished, JobOutcome},
    panics,
    worker::Worker,
};
use crate::{pipeline::NodeId, run::job::Job};

/// One thread for each job that runs. The scope that the threads belong to ends when every job has ended.
pub(super) struct Threads<'scope, 'env> {
    scope: &'scope Scope<'scope, 'env>,
    worker: &'env Worker<'env>,
    send: Sender<Finished>,
    finished: Receiver<Finished>,
}

impl<'scope, 'env> Threads<'scope, 'env> {
    pub(super) fn new(scope: &'scope Scope<'scope, 'env>, worker: &'env Worker<'env>) -> Self {
        let (send, finished) = channel();
        Self { scope, worker, send, finished }
    }
}

impl Executor for Threads<'_, '_> {
    fn start(&mut self, id: NodeId, job: Job) -> anyhow::Result<()> {
        let (worker, send) = (self.worker, self.send.clone());
        self.scope.spawn(move || {
            let finished = work(worker, id, &job);
            // Nobody waits any more where the scheduler has stopped with an error.
            let _ = send.send(finished);
        });
        Ok(())
    }

    fn wait(&mut self, patience: Duration) -> Option<Finished> {
        self.finished.recv_timeout(patience).ok()
    }
}

fn work(worker: &Worker<'_>, id: NodeId, job: &Job) -> Finished {
    let start = Instant::now();
    // A panic of the engine must end the job too, or the run would wait for it for ever.
    let outcome = catch_unwind(AssertUnwindSafe(|| worker.perform(job)))
        .unwrap_or_else(|payload| JobOutcome::Failed(Failure::of_system(&panics::explain("", &*payload))));
    Finished { id, outcome, secs: start.elapsed().as_secs_f64() }
}
