//! The recorder that stages write to. It never fails a stage, never panics and never changes a result.
//!
//! The first error turns the recorder off and leaves one warning for the run.

#![allow(
    clippy::disallowed_methods,
    reason = "wall time paces flushes and measures the cost of recording; recordings hold logical time only"
)]

use std::{
    path::{Path, PathBuf},
    time::{Duration, Instant},
};

use super::{
    canonical::{self, Digests},
    encode::Encoder,
    frame::{Level, MapFrame, TrajectoryFrame},
    live::LiveFile,
    node_info::NodeInfo,
    time::At,
};
use crate::failpoint::failpoint;

/// Writes the recording of one node.
#[derive(Default)]
pub struct Recorder {
    open: Option<Box<Open>>,
    warning: Option<String>,
    spent: Duration,
}

/// A recording that is being written.
struct Open {
    path: PathBuf,
    encoder: Encoder,
}

/// The recording of a node that has finished.
#[derive(Debug)]
pub struct Finished {
    /// blake3 of the messages: topic, schema, time and payload of each, in order.
    pub messages_digest: Option<[u8; 32]>,
    /// blake3 of the file.
    pub file_digest: Option<[u8; 32]>,
    /// The canonical file; `None` if recording was off or failed.
    pub path: Option<PathBuf>,
    /// Time spent on recording.
    pub spent: Duration,
    /// What went wrong, if anything did.
    pub warning: Option<String>,
}

impl std::fmt::Debug for Recorder {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let path = self.open.as_ref().map(|open| &open.path);
        f.debug_struct("Recorder").field("path", &path).field("warning", &self.warning).finish_non_exhaustive()
    }
}

impl Recorder {
    /// A recorder that records nothing.
    pub fn off() -> Recorder {
        Recorder::default()
    }

    /// Starts a recording in a new file at `path`.
    pub fn create(path: &Path, node: &NodeInfo) -> Recorder {
        let started = Instant::now();
        let mut recorder = Recorder::off();
        match LiveFile::create(path, node) {
            Ok(file) => {
                let encoder = Encoder::new(file, node.kind.clone());
                recorder.open = Some(Box::new(Open { path: path.to_owned(), encoder }));
            }
            Err(error) => recorder.fail(path, &error.into()),
        }
        recorder.spent = started.elapsed();
        recorder
    }

    /// Records named values, such as the terms of a loss. Names are protobuf field names: letters, digits and `_`.
    pub fn scalars(&mut self, topic: &str, at: At, values: &[(&'static str, f64)]) {
        self.record(|encoder| encoder.scalars(topic, at, values));
    }

    /// Records the latents of known states and of the goals, on three topics: `TOPIC`, `TOPIC/goals` and
    /// `TOPIC/quality`.
    pub fn latent_map(&mut self, topic: &str, at: At, map: &MapFrame<'_>) {
        self.record(|encoder| encoder.latent_map(topic, at, map));
        self.scalars(&format!("{topic}/quality"), at, &[("quality", map.quality)]);
    }

    /// Records the obstacles of the true space; each is row, column and radius.
    pub fn obstacles(&mut self, topic: &str, at: At, circles: &[[f32; 3]]) {
        self.record(|encoder| encoder.obstacles(topic, at, circles));
    }

    /// Records a picture, row by row; 0 is black. A pixel has one byte, or three for red, green and blue.
    pub fn picture(&mut self, topic: &str, at: At, height: u32, width: u32, bytes: &[u8]) {
        let pixels = u64::from(height) * u64::from(width);
        if ![pixels, 3 * pixels].contains(&(bytes.len() as u64)) {
            let warning = format!("picture `{topic}` has {} bytes, which is not {height}x{width}", bytes.len());
            self.warning.get_or_insert(warning);
            return;
        }
        self.record(|encoder| encoder.picture(topic, at, height, width, bytes));
    }

    /// Records one evaluated episode in true space.
    pub fn trajectory(&mut self, topic: &str, at: At, episode: &TrajectoryFrame<'_>) {
        self.record(|encoder| encoder.trajectory(topic, at, episode));
    }

    /// Records a text on the topic `/log`.
    pub fn log(&mut self, at: At, level: Level, text: &str) {
        self.record(|encoder| encoder.log(at, level, text));
    }

    /// Time spent in the recorder so far.
    pub fn spent(&self) -> Duration {
        self.spent
    }

    /// The warning, if there is one that was not taken yet.
    pub fn take_warning(&mut self) -> Option<String> {
        self.warning.take()
    }

    /// Rewrites the live file to `canonical` and removes the live file. Equal messages give equal bytes, whenever the
    /// live file was flushed.
    pub fn finish(mut self, canonical: &Path) -> Finished {
        let started = Instant::now();
        let digests = self.open.take().and_then(|open| match open.finish(canonical) {
            Ok(digests) => Some(digests),
            Err(error) => {
                self.fail(canonical, &error);
                None
            }
        });
        Finished {
            path: digests.map(|_| canonical.to_owned()),
            messages_digest: digests.map(|digests| digests.messages),
            file_digest: digests.map(|digests| digests.file),
            spent: self.spent + started.elapsed(),
            warning: self.warning,
        }
    }

    /// Writes one message. An error turns the recorder off.
    fn record(&mut self, write: impl FnOnce(&mut Encoder) -> anyhow::Result<()>) {
        let Some(open) = &mut self.open else { return };
        let started = Instant::now();
        let outcome = write(&mut open.encoder).and_then(|()| Ok(open.encoder.file.flush_if_due(started)?));
        if let Err(error) = outcome
            && let Some(open) = self.open.take()
        {
            self.fail(&open.path, &error);
        }
        self.spent += started.elapsed();
    }

    /// Turns an error into the warning. The warning names the root cause only, because the texts of the libraries
    /// around it add nothing.
    fn fail(&mut self, path: &Path, error: &anyhow::Error) {
        let (path, cause) = (path.display(), error.root_cause());
        let warning = format!("cannot record to {path}: {cause}; the run goes on without this recording");
        self.warning.get_or_insert(warning);
    }
}

impl Open {
    fn finish(mut self, canonical: &Path) -> anyhow::Result<Digests> {
        self.encoder.file.flush()?;
        drop(self.encoder);
        let digests = canonical::rewrite(&self.path, canonical)?;
        // If the live file cannot be removed, it stays. Nothing reads it again.
        let _ = failpoint!("remove live recording", std::fs::remove_file(&self.path));
        Ok(digests)
    }
}
