//! The live view of a run: a process of its own, so that a viewer that hangs or dies cannot touch the run.

#![allow(clippy::disallowed_methods, reason = "wall time is shown to people; no result holds it")]

use std::{
    fs::{self, File},
    os::unix::process::CommandExt as _,
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    sync::{Mutex, PoisonError},
    thread::sleep,
    time::{Duration, Instant},
};

use crate::{run::events::Event, store::LocalStore};

/// How long a finished run waits for its view to write a file.
const PATIENCE: Duration = Duration::from_secs(20);

/// Starts `carl-pipe view --follow` when the run begins, and watches whether it lives.
pub(crate) struct LiveView {
    sink: String,
    artifacts: PathBuf,
    running: Mutex<Option<(Child, PathBuf)>>,
}

impl LiveView {
    pub(crate) fn new(sink: String, store: &LocalStore) -> Self {
        Self { sink, artifacts: store.root().to_owned(), running: Mutex::default() }
    }

    /// Hears of an event; returns what went wrong with the view, once.
    pub(crate) fn on_event(&self, event: &Event) -> Option<String> {
        match event {
            Event::RunStarted { run, .. } => self.start(run),
            Event::NodeStarted { .. } | Event::NodeFinished { .. } | Event::Progress { .. } => self.has_died(),
            _ => None,
        }
    }

    /// Starts it in its own process group, out of reach of Ctrl-C; it ends by itself when the run does.
    fn start(&self, run: &str) -> Option<String> {
        let log = self.artifacts.join("runs").join(run).join("view.log");
        let child = File::create(&log).and_then(|out| {
            let errors = out.try_clone()?;
            // The very program that runs, even if a build has replaced its file.
            Command::new("/proc/self/exe")
                .args(["view", "--follow", run, "--rerun", &self.sink, "--artifacts"])
                .arg(&self.artifacts)
                .stdin(Stdio::null())
                .stdout(out)
                .stderr(errors)
                .process_group(0)
                .spawn()
        });
        match child {
            Ok(child) => {
                *self.running.lock().unwrap_or_else(PoisonError::into_inner) = Some((child, log));
                None
            }
            Err(error) => Some(format!("no live view: {error}")),
        }
    }

    /// Waits a while for a view that writes a file; any other goes on alone.
    pub(crate) fn close(&self) -> Option<String> {
        let start = Instant::now();
        while self.sink.starts_with("save=") && start.elapsed() < PATIENCE {
            let warning = self.has_died();
            if warning.is_some() || self.running.lock().unwrap_or_else(PoisonError::into_inner).is_none() {
                return warning;
            }
            sleep(Duration::from_millis(20));
        }
        None
    }

    fn has_died(&self) -> Option<String> {
        let mut running = self.running.lock().unwrap_or_else(PoisonError::into_inner);
        let (child, log) = running.as_mut()?;
        let status = child.try_wait().ok().flatten()?;
        let why = last_line(log).unwrap_or_else(|| status.to_string());
        *running = None;
        (!status.success()).then(|| format!("the live view ended: {why}; the run goes on"))
    }
}

fn last_line(log: &Path) -> Option<String> {
    let text = fs::read_to_string(log).ok()?;
    let line = text.lines().rev().find(|line| !line.trim().is_empty())?;
    Some(line.trim_start_matches("error: ").to_owned())
}
