//! Reads the `events.jsonl` of a run while the run appends to it.

use std::{
    fs::File,
    io::{ErrorKind, Read as _},
    path::{Path, PathBuf},
};

use anyhow::Context as _;
use carl_pipe::run::events::Event;

/// A reader of a run's events.
#[derive(Debug)]
pub(crate) struct EventLog {
    path: PathBuf,
    file: Option<File>,
    /// Bytes that were read and not yet parsed. The last line may be incomplete.
    unparsed: Vec<u8>,
}

impl EventLog {
    /// Reads the events of the run in this folder. The file need not exist yet.
    pub(crate) fn of_run(run_dir: &Path) -> EventLog {
        EventLog { path: run_dir.join("events.jsonl"), file: None, unparsed: Vec::new() }
    }

    /// The next event, or `None` if the file has no further complete line yet. A line that is no known event is
    /// skipped, since a newer version of the program may have written it.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub(crate) fn poll(&mut self) -> anyhow::Result<Option<Event>> {
        self.read_more().with_context(|| format!("cannot read {}", self.path.display()))?;
        while let Some(end) = self.unparsed.iter().position(|&byte| byte == b'\n') {
            let line: Vec<u8> = self.unparsed.drain(..=end).collect();
            if let Ok(event) = serde_json::from_slice(&line) {
                return Ok(Some(event));
            }
        }
        Ok(None)
    }

    fn read_more(&mut self) -> std::io::Result<()> {
        if self.unparsed.contains(&b'\n') {
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
            file.read_to_end(&mut self.unparsed)?;
        }
        Ok(())
    }
}
