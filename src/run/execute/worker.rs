//! One node's work, from verified inputs to a published output.

#![allow(
    clippy::disallowed_methods,
    reason = "wall times are kept beside a run and name its folder; no key and no result holds one"
)]

use std::{
    panic::{AssertUnwindSafe, catch_unwind},
    path::Path,
    sync::atomic::AtomicBool,
    time::Instant,
};

use super::{Failure, cores::Cores, host::NodeHost, panics, recording, teams::Teams};
use crate::{
    artifact::Files,
    num::Threads,
    pipeline::{Node, NodeId},
    run::{events::Events, key::Key},
    stage::{InputFiles, Interrupted, StageCx},
    store::{Draft, Entry, KeyLock, Published, Store},
};

/// A node that is ready to work.
pub(super) struct Job<'a> {
    pub(super) id: NodeId,
    pub(super) node: &'a Node,
    pub(super) key: Key,
    /// Every input by port, with the node that made it.
    pub(super) inputs: Vec<(&'static str, Vec<(NodeId, Entry)>)>,
    /// Held until the output is published.
    pub(super) _lock: KeyLock,
}

/// What the jobs of a run share.
#[derive(Clone, Copy)]
pub(super) struct Shop<'a> {
    pub(super) store: &'a Store,
    pub(super) run: &'a str,
    pub(super) run_dir: &'a Path,
    pub(super) events: &'a Events<'a>,
    pub(super) cores: &'a Cores,
    pub(super) teams: &'a Teams,
    pub(super) stop: &'a AtomicBool,
}

/// How a job ended.
pub(super) enum Ended {
    Published(Box<Published>),
    Failed(Failure),
    /// The user asked to stop.
    Stopped,
    /// An input cannot be used: its maker has to run again.
    Damaged {
        maker: NodeId,
        what: String,
    },
}

/// Does a job; returns how it ended and how long it took.
pub(super) fn work(shop: Shop<'_>, job: Job<'_>) -> (Ended, f64) {
    let start = Instant::now();
    let threads = shop.cores.join(job.id);
    // A panic of ours must end the node too, or the run would wait for it for ever.
    let ended = catch_unwind(AssertUnwindSafe(|| attempt(shop, &job, threads, start)));
    let ended = ended.unwrap_or_else(|payload| {
        Err(Failure { text: format!("{:#}", panics::explain("", &*payload)), is_store: true })
    });
    shop.cores.leave(job.id);
    (ended.unwrap_or_else(Ended::Failed), start.elapsed().as_secs_f64())
}

fn attempt(shop: Shop<'_>, job: &Job<'_>, threads: Threads, start: Instant) -> Result<Ended, Failure> {
    let inputs = match load(shop.store, job).map_err(of_store)? {
        Ok(inputs) => inputs,
        Err((maker, what)) => return Ok(Ended::Damaged { maker, what }),
    };
    let host = NodeHost::new(&job.node.name, job.node.round, shop.events, shop.stop);
    let mut recorder = recording::start(shop.run_dir, job.node, &job.key);
    let made = {
        let mut files = InputFiles::default();
        for (port, values) in &inputs {
            files.by_port.insert(port, values.iter().collect());
        }
        let stream = job.node.stream.clone();
        let mut cx = StageCx::new(&mut recorder, &job.node.task, stream, job.node.round.unwrap_or(0), threads, &host);
        shop.teams.run(|| (job.node.kind.run)(&job.node.params, &files, &mut cx))
    };
    drop(inputs);
    let files = match made {
        Ok(files) => files,
        Err(error) if error.chain().any(|cause| cause.is::<Interrupted>()) => return Ok(Ended::Stopped),
        Err(error) => return Err(Failure { text: format!("{error:#}"), is_store: false }),
    };
    publish(shop, job, &files, recorder, host, start)
        .map(|published| Ended::Published(Box::new(published)))
        .map_err(of_store)
}

fn publish(
    shop: Shop<'_>,
    job: &Job<'_>,
    files: &Files,
    recorder: crate::record::Recorder,
    host: NodeHost<'_>,
    start: Instant,
) -> anyhow::Result<Published> {
    let canonical = shop.store.temporary().join(format!("{}-{}.mcap", shop.run, job.id));
    let recorded = recording::finish(recorder, &canonical);
    if let Some(warning) = recorded.warning {
        shop.events.warn(Some(&job.node.name), warning);
    }
    shop.store.publish(Draft {
        key: &job.key,
        node: &job.node.name,
        run: shop.run,
        files,
        recording: recorded.file.as_ref().map(|(path, messages)| (path.as_path(), *messages)),
        metrics: host.into_metrics(),
        secs: start.elapsed().as_secs_f64(),
        recorder_secs: recorded.secs,
    })
}

type Loaded = Vec<(&'static str, Vec<Files>)>;

/// Reads and verifies every input; the inner error names the maker of a bad one, and what is wrong.
fn load(store: &Store, job: &Job<'_>) -> anyhow::Result<Result<Loaded, (NodeId, String)>> {
    let mut loaded = Vec::new();
    for (port, entries) in &job.inputs {
        let mut values = Vec::new();
        for (maker, entry) in entries {
            match store.load(entry)? {
                Ok(files) => values.push(files),
                Err((file, why)) => return Ok(Err((*maker, format!("its {file} is {why}")))),
            }
        }
        loaded.push((*port, values));
    }
    Ok(Ok(loaded))
}

fn of_store(error: anyhow::Error) -> Failure {
    Failure { text: format!("{error:#}"), is_store: true }
}
