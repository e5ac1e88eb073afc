//! The live view of a run. It is a separate process, so a viewer that hangs or dies cannot change the run.

#![allow(clippy::disallowed_methods, reason = "wall time is shown to people; no result holds it")]

use std::{
    fs::{self, File},
    os::unix::process::CommandExt as _,
    path::{Path, PathBuf},
    process::{Child, Stdio},
    sync::{Mutex, MutexGuard, PoisonError},
    thread::sleep,
    time::{Duration, Instant},
};

use super::{
    exit::Error,
    sink::Sink,
    view::{self, ViewTarget},
    view_program,
};
use crate::run::events::Event;

/// How long a finished run waits for its view to complete a file.
const SAVE_TIMEOUT: Duration = Duration::from_secs(20);

/// Starts `carl-view --follow` when the run begins, and reports when it dies.
pub(crate) struct LiveView {
    program: PathBuf,
    sink: Sink,
    /// The folder of all runs.
    runs: PathBuf,
    running: Mutex<Option<Running>>,
}

/// A view that was started.
struct Running {
    child: Child,
    /// Everything that the view prints.
    log: PathBuf,
}

impl LiveView {
    /// Finds the program for a live view. The view starts with the run's first event.
    ///
    /// # Errors
    /// If `carl-view` is missing or has another version.
    pub(crate) fn new(sink: Sink, runs: PathBuf) -> Result<Self, Error> {
        Ok(Self { program: view_program::find()?, sink, runs, running: Mutex::default() })
    }

    /// Takes an event of the run. Returns a warning if the view could not start or has died since the last event.
    pub(crate) fn on_event(&self, event: &Event) -> Option<String> {
        match event {
            Event::RunStarted { run, .. } => self.start(run),
            Event::NodeStarted { .. } | Event::NodeFinished { .. } | Event::Progress { .. } => self.check(),
            _ => None,
        }
    }

    /// Starts the view in a process group of its own, where Ctrl-C does not reach it. The view ends when the run ends.
    fn start(&self, run: &str) -> Option<String> {
        let run_dir = self.runs.join(run);
        let log = run_dir.join("view.log");
        let child = File::create(&log).and_then(|out| {
            let errors = out.try_clone()?;
            view::command(&self.program, &ViewTarget::Follow(run_dir), &self.sink)
                .stdin(Stdio::null())
                .stdout(out)
                .stderr(errors)
                .process_group(0)
                .spawn()
        });
        match child {
            Ok(child) => {
                *self.running() = Some(Running { child, log });
                None
            }
            Err(error) => Some(format!("cannot start the live view: {error}; the run goes on")),
        }
    }

    /// Waits a limited time for a view that writes a file. Any other view goes on after the run.
    pub(crate) fn close(&self) -> Option<String> {
        let start = Instant::now();
        while matches!(self.sink, Sink::Save { .. }) && start.elapsed() < SAVE_TIMEOUT {
            let warning = self.check();
            if warning.is_some() || self.running().is_none() {
                return warning;
            }
            sleep(Duration::from_millis(20));
        }
        None
    }

    /// A warning if the view has failed since the last check.
    fn check(&self) -> Option<String> {
        let mut running = self.running();
        let Running { child, log } = running.as_mut()?;
        let status = child.try_wait().ok().flatten()?;
        let why = last_line(log).unwrap_or_else(|| status.to_string());
        *running = None;
        (!status.success()).then(|| format!("the live view ended: {why}; the run goes on"))
    }

    fn running(&self) -> MutexGuard<'_, Option<Running>> {
        self.running.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn last_line(log: &Path) -> Option<String> {
    let text = fs::read_to_string(log).ok()?;
    let line = text.lines().rev().find(|line| !line.trim().is_empty())?;
    Some(line.trim_start_matches("error: ").to_owned())
}
