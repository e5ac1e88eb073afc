//! Shows the recording of one node: first the file that grows while the node works, then the published file. Every
//! message is shown once.

use std::path::{Path, PathBuf};

use carl_pipe::record::{Message, Polled, Reader};

use crate::{
    host::ViewHost,
    timeline::{Lane, Offset},
    viewer::{Position, Viewer},
};

/// The recording of one node in a view.
#[derive(Debug)]
pub(crate) struct Playback {
    /// Name of the lane, after the prefix of the run.
    lane: String,
    /// The branch of the run that the node belongs to.
    pub(crate) branch: String,
    round: u32,
    start: Offset,
    /// The first step and epoch after the last message.
    pub(crate) end: Offset,
    file: Option<PathBuf>,
    reader: Option<Reader>,
    /// How many messages of the node were shown.
    shown: u64,
    /// How many messages of the present file to skip, because another file of this node held them too.
    skip: u64,
    finished: bool,
}

impl Playback {
    /// A node of which nothing was shown yet. The `prefix` tells the runs of one view apart.
    pub(crate) fn new(lane: Lane, prefix: &str, round: u32, start: Offset) -> Playback {
        Playback {
            lane: format!("{prefix}{}", lane.name),
            branch: lane.branch,
            round,
            start,
            end: start,
            file: None,
            reader: None,
            shown: 0,
            skip: 0,
            finished: false,
        }
    }

    /// Continues with this file. It begins with the messages that were shown already.
    pub(crate) fn switch_to(&mut self, file: PathBuf) {
        self.reader = None;
        self.file = Some(file);
        self.skip = self.shown;
        self.finished = false;
    }

    /// Shows what is new in the file; true if there was something new. A recording that cannot be read is reported to
    /// the host, and what came before the damage stays.
    ///
    /// # Errors
    /// If the viewer is gone.
    pub(crate) fn show_new(&mut self, viewer: &mut dyn Viewer, host: &dyn ViewHost) -> anyhow::Result<bool> {
        let Some(file) = self.file.clone() else { return Ok(false) };
        let before = self.shown;
        match self.read(&file, viewer, host) {
            Ok(()) => {}
            Err(Failure::Viewer(error)) => return Err(error),
            Err(Failure::Recording(error)) => {
                host.note(&format!("cannot read {}: {error:#}; showing what came before", file.display()));
                self.stop_reading();
            }
        }
        Ok(self.shown > before)
    }

    /// Shows the rest of the present file and closes it.
    ///
    /// # Errors
    /// If the viewer is gone.
    pub(crate) fn show_rest(&mut self, viewer: &mut dyn Viewer, host: &dyn ViewHost) -> anyhow::Result<()> {
        self.show_new(viewer, host)?;
        match &self.file {
            Some(file) if !file.exists() => host.note(&format!("there is no recording {}", file.display())),
            Some(file) if !self.finished => {
                host.note(&format!("{} ends early; showing what it holds", file.display()));
            }
            _ => {}
        }
        self.stop_reading();
        Ok(())
    }

    /// The position of the node's latest message. Texts about the node are shown there.
    pub(crate) fn position(&self) -> Position {
        self.position_at(self.end.step.saturating_sub(1).max(self.start.step), self.end.epoch.saturating_sub(1))
    }

    fn position_at(&self, step: u64, epoch: u64) -> Position {
        Position { lane: self.lane.clone(), round: self.round, epoch: epoch.max(self.start.epoch), step }
    }

    fn stop_reading(&mut self) {
        self.reader = None;
        self.file = None;
        self.finished = true;
    }

    fn read(&mut self, file: &Path, viewer: &mut dyn Viewer, host: &dyn ViewHost) -> Result<(), Failure> {
        if self.finished {
            return Ok(());
        }
        let mut reader = match self.reader.take() {
            Some(reader) => reader,
            // A run names a recording before the file exists.
            None if !file.exists() => return Ok(()),
            None => Reader::open(file).map_err(Failure::Recording)?,
        };
        while !host.should_stop() {
            match reader.poll().map_err(Failure::Recording)? {
                Polled::Message(_) if self.skip > 0 => self.skip -= 1,
                Polled::Message(raw) => {
                    self.shown += 1;
                    if let Some(message) = Message::decode(&raw).map_err(Failure::Recording)? {
                        self.show(&message, viewer).map_err(Failure::Viewer)?;
                    }
                }
                Polled::Metadata(_) => {}
                Polled::Waiting => break,
                Polled::End => {
                    self.finished = true;
                    break;
                }
            }
        }
        self.reader = Some(reader);
        Ok(())
    }

    fn show(&mut self, message: &Message, viewer: &mut dyn Viewer) -> anyhow::Result<()> {
        let step = self.start.step.saturating_add(message.at.step);
        let epoch = self.start.epoch.saturating_add(u64::from(message.at.epoch));
        self.end = self.end.max(Offset { step: step.saturating_add(1), epoch: epoch.saturating_add(1) });
        viewer.show(&self.position_at(step, epoch), message)
    }
}

/// What stopped the reading: a damaged recording ends one playback, a viewer that is gone ends the view.
enum Failure {
    Recording(anyhow::Error),
    Viewer(anyhow::Error),
}
