//! Does a job: verifies its inputs, runs its stage and publishes the output.

#![allow(clippy::disallowed_methods, reason = "an entry says how long its node worked; no key or result holds a time")]

use std::{
    path::{Path, PathBuf},
    sync::atomic::AtomicBool,
    time::Instant,
};

use anyhow::Context as _;

use super::{
    cores::Cores,
    executor::{Failure, JobOutcome},
    host::NodeHost,
    recording::{self, Recorded},
    teams::Teams,
};
use crate::{
    digest::Digest,
    num::Threads,
    record::Recorder,
    run::{
        events::Events,
        job::{Job, JobInput},
        named_files::NamedFiles,
    },
    stage::{InputFiles, Interrupted, Kind, StageCx},
    store::{self, Files, Key, NewEntry, NewRecording, Published, ResultStore},
};

/// What the jobs of a run share.
#[derive(Debug, Clone, Copy)]
pub struct RunContext<'a> {
    /// Has the inputs and takes the outputs.
    pub store: &'a dyn ResultStore,
    /// The kinds that jobs may name.
    pub kinds: &'a [&'static Kind],
    /// The id of the run.
    pub run: &'a str,
    /// The folder of the run, for live recordings.
    pub run_dir: &'a Path,
    /// Takes the events of the jobs.
    pub events: &'a Events<'a>,
    /// Set once the user asked to stop.
    pub stop: &'a AtomicBool,
}

/// Does the jobs of a run, several at once if several threads ask.
#[derive(Debug)]
pub struct Worker<'a> {
    context: RunContext<'a>,
    cores: Cores,
    teams: Teams,
}

impl<'a> Worker<'a> {
    /// A worker whose jobs share this many cores.
    pub fn new(context: RunContext<'a>, cores: usize) -> Self {
        Self { context, cores: Cores::new(cores), teams: Teams::new(cores.max(1)) }
    }

    /// Does a job.
    pub fn perform(&self, job: &Job) -> JobOutcome {
        let share = self.cores.join(job.threads);
        self.attempt(job, share.threads(), Instant::now()).unwrap_or_else(JobOutcome::Failed)
    }

    fn attempt(&self, job: &Job, threads: Threads, start: Instant) -> Result<JobOutcome, Failure> {
        let kind = self.kind(job).map_err(|error| Failure::of_system(&error))?;
        let inputs = match self.load(job) {
            Ok(inputs) => inputs,
            Err(Unloaded::Damaged { made_by, problem }) => return Ok(JobOutcome::DamagedInput { made_by, problem }),
            Err(Unloaded::Refused(error)) => return Err(Failure::of_system(&error.into())),
        };
        let key = job.key();
        let files = NamedFiles { run_dir: self.context.run_dir, files: &job.files };
        let folder = self.context.store.scratch_path(&format!("work-{}-{}", self.context.run, key.digest.hex()));
        let host = NodeHost::new((&job.node, job.round), self.context.events, self.context.stop, files, folder);
        let mut recorder = recording::start(self.context.run_dir, job, &key);
        let made = self.run_stage(kind, job, &inputs, threads, &mut recorder, &host);
        drop(inputs);
        let files = match made {
            Ok(files) => files,
            Err(error) if error.chain().any(|cause| cause.is::<Interrupted>()) => return Ok(JobOutcome::Stopped),
            Err(error) => return Err(Failure::Stage(format!("{error:#}"))),
        };
        let made = Made { files, recorded: self.finish_recording(job, &key, recorder), host, start };
        let published = self.publish(job, &key, made).map_err(|error| Failure::of_system(&error.into()))?;
        Ok(JobOutcome::Published(Box::new(published)))
    }

    fn kind(&self, job: &Job) -> anyhow::Result<&'static Kind> {
        let (name, version) = (&job.work.kind, job.work.version);
        let kind = self.context.kinds.iter().find(|kind| kind.name == name && kind.version == version);
        let kind = kind.with_context(|| format!("this carl-pipe has no kind `{name}` of version {version}"))?;
        Ok(kind.declared(&job.work.params, job.inputs.iter().map(|port| port.port.as_str())))
    }

    fn run_stage(
        &self,
        kind: &Kind,
        job: &Job,
        inputs: &[Vec<Files>],
        threads: Threads,
        recorder: &mut Recorder,
        host: &NodeHost<'_>,
    ) -> anyhow::Result<Files> {
        let mut files = InputFiles::default();
        for (port, values) in job.inputs.iter().zip(inputs) {
            let known = kind.ports.iter().find(|known| known.name == port.port);
            let known = known.with_context(|| format!("`{}` has no input `{}`", kind.name, port.port))?;
            files.by_port.insert(known.name, values.iter().collect());
        }
        let (stream, round) = (job.work.stream.clone(), job.round.unwrap_or(0));
        let task = job.work.task.with_own_log();
        let mut cx = StageCx::new(recorder, &task, stream, round, threads, host);
        let made = self.teams.run(|| (kind.run)(&job.work.params, &files, &mut cx));
        cx.say_log();
        made
    }

    fn finish_recording(&self, job: &Job, key: &Key, recorder: Recorder) -> Recorded {
        let recorded = recording::finish(recorder, &self.canonical(key));
        if let Some(warning) = &recorded.warning {
            self.context.events.warn(Some(&job.node), warning.clone());
        }
        recorded
    }

    /// Where the finished recording of a key lies until it is published.
    fn canonical(&self, key: &Key) -> PathBuf {
        self.context.store.scratch_path(&format!("{}-{}.mcap", self.context.run, key.digest.hex()))
    }

    fn publish(&self, job: &Job, key: &Key, made: Made<'_>) -> store::Result<Published> {
        let recording = made.recorded.file.as_ref().map(|(file, messages)| NewRecording { file, messages: *messages });
        self.context.store.publish(NewEntry {
            key,
            node: &job.node,
            run: self.context.run,
            files: &made.files,
            recording,
            metrics: made.host.metrics(),
            secs: made.start.elapsed().as_secs_f64(),
            recorder_secs: made.recorded.secs,
        })
    }

    /// Loads and verifies the inputs of every port.
    fn load(&self, job: &Job) -> Result<Vec<Vec<Files>>, Unloaded> {
        job.inputs.iter().map(|port| port.inputs.iter().map(|input| self.load_input(input)).collect()).collect()
    }

    fn load_input(&self, input: &JobInput) -> Result<Files, Unloaded> {
        let damaged = |problem: String| Unloaded::Damaged { made_by: input.made_by, problem };
        let entry = self.context.store.entry(input.made_by).map_err(Unloaded::Refused)?;
        let Some(entry) = entry.filter(|entry| entry.output == input.content) else {
            return Err(damaged("its entry is gone".to_owned()));
        };
        self.context.store.load(&entry).map_err(|error| match error {
            store::Error::Unusable { .. } => damaged(error.to_string()),
            error => Unloaded::Refused(error),
        })
    }
}

/// What a stage has made.
struct Made<'a> {
    files: Files,
    recorded: Recorded,
    host: NodeHost<'a>,
    start: Instant,
}

/// Why an input was not loaded.
enum Unloaded {
    Damaged { made_by: Digest, problem: String },
    Refused(store::Error),
}
