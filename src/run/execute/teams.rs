//! Teams of threads that run stages. A job takes an idle team and gives it back, because threads that are used again
//! keep the buffers of matrix products and the memory of the allocator.

use std::{
    panic::{AssertUnwindSafe, catch_unwind},
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicUsize, Ordering},
    },
};

use anyhow::Context as _;

use super::panics;

/// The teams of a run.
#[derive(Debug)]
pub(super) struct Teams {
    cores: usize,
    made: AtomicUsize,
    idle: Mutex<Vec<Team>>,
}

#[derive(Debug)]
struct Team {
    name: String,
    pool: rayon::ThreadPool,
}

impl Teams {
    /// Teams of as many threads as there are cores.
    pub(super) fn new(cores: usize) -> Self {
        Self { cores, made: AtomicUsize::new(0), idle: Mutex::default() }
    }

    /// Does work on a team, and turns a panic into an error.
    pub(super) fn run<R: Send>(&self, work: impl FnOnce() -> anyhow::Result<R> + Send) -> anyhow::Result<R> {
        let team = self.take()?;
        let done = catch_unwind(AssertUnwindSafe(|| team.pool.install(work)));
        let done = done.unwrap_or_else(|payload| Err(panics::explain(&team.name, &*payload)));
        self.idle.lock().unwrap_or_else(PoisonError::into_inner).push(team);
        done
    }

    fn take(&self) -> anyhow::Result<Team> {
        if let Some(team) = self.idle.lock().unwrap_or_else(PoisonError::into_inner).pop() {
            return Ok(team);
        }
        let name = panics::team_name(self.made.fetch_add(1, Ordering::Relaxed));
        let thread_name = name.clone();
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(self.cores)
            .thread_name(move |_| thread_name.clone())
            .build()
            .context("cannot start threads")?;
        Ok(Team { name, pool })
    }
}
