//! Reads a run's `events.jsonl` as it grows. Events and fields that it does not know are passed over.

use std::{
    fs::File,
    io::{ErrorKind, Read as _},
    path::{Path, PathBuf},
};

use anyhow::Context as _;
use serde::Deserialize;
use serde_json::Value;

/// What happened in a run.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(tag = "event", rename_all = "snake_case")]
pub(super) enum Event {
    RunStarted {
        #[serde(default)]
        pipeline: Option<String>,
        #[serde(default)]
        seed: Option<Value>,
    },
    NodeStarted {
        node: String,
        #[serde(default)]
        round: u32,
        #[serde(default)]
        recording: Option<PathBuf>,
    },
    NodeFinished {
        node: String,
        #[serde(default)]
        round: u32,
        #[serde(default)]
        state: Option<String>,
        #[serde(default)]
        recording: Option<PathBuf>,
    },
    #[serde(rename = "figure")]
    Metric {
        #[serde(default)]
        node: Option<String>,
        name: String,
        value: Value,
    },
    Say {
        #[serde(default)]
        node: Option<String>,
        text: String,
    },
    RunFinished {},
}

/// The events of a run so far, and those to come.
#[derive(Debug)]
pub(super) struct Events {
    path: PathBuf,
    file: Option<File>,
    /// What was read and not yet taken; the last line may lack its end.
    text: Vec<u8>,
}

impl Events {
    pub(super) fn of_run(run_dir: &Path) -> Events {
        Events { path: run_dir.join("events.jsonl"), file: None, text: Vec::new() }
    }

    /// The next event; none if the file holds no further whole line yet, or does not exist yet.
    pub(super) fn poll(&mut self) -> anyhow::Result<Option<Event>> {
        self.read_on().with_context(|| format!("cannot read {}", self.path.display()))?;
        while let Some(end) = self.text.iter().position(|&byte| byte == b'\n') {
            let line: Vec<u8> = self.text.drain(..=end).collect();
            if let Ok(event) = serde_json::from_slice(&line) {
                return Ok(Some(event));
            }
        }
        Ok(None)
    }

    fn read_on(&mut self) -> std::io::Result<()> {
        if self.text.contains(&b'\n') {
            return Ok(());
        }
        if self.file.is_none() {
            self.file = match File::open(&self.path) {
                Ok(file) => Some(file),
                Err(error) if error.kind() == ErrorKind::NotFound => return Ok(()),
                Err(error) => return Err(error),
            };
        }
        if let Some(file) = &mut self.file {
            file.read_to_end(&mut self.text)?;
        }
        Ok(())
    }
}
