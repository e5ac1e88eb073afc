//! Shows one recording: as it grows, then from its published file, each message once.

use std::path::{Path, PathBuf};

use super::{
    Message, Place, Polled, Reader, Screen, Watcher,
    story::{Offset, lane_and_point},
};

/// One node's recording on a screen.
#[derive(Debug)]
pub(super) struct Playback {
    pub lane: String,
    pub point: String,
    round: u32,
    start: Offset,
    /// Just after the last message.
    pub end: Offset,
    path: Option<PathBuf>,
    reader: Option<Reader>,
    shown: u64,
    /// Messages of the present file that another file of this node already showed.
    skip: u64,
    finished: bool,
}

impl Playback {
    pub(super) fn new(node: &str, prefix: &str, round: u32, start: Offset) -> Playback {
        let (lane, point) = lane_and_point(node);
        Playback {
            lane: format!("{prefix}{lane}"),
            point,
            round,
            start,
            end: start,
            path: None,
            reader: None,
            shown: 0,
            skip: 0,
            finished: false,
        }
    }

    /// Goes on with this file, which begins with the messages that were shown already.
    pub(super) fn switch_to(&mut self, path: PathBuf) {
        self.reader = None;
        self.path = Some(path);
        self.skip = self.shown;
        self.finished = false;
    }

    /// Shows what is new; true if there was something.
    pub(super) fn show_new(&mut self, screen: &mut dyn Screen, watcher: &dyn Watcher) -> anyhow::Result<bool> {
        let Some(path) = self.path.clone() else { return Ok(false) };
        let before = self.shown;
        match self.read(&path, screen, watcher) {
            Ok(()) => {}
            // The screen's errors end the view, a recording's do not.
            Err(Trouble::Screen(error)) => return Err(error),
            Err(Trouble::Recording(error)) => {
                watcher.say(&format!("cannot read {}: {error:#}; showing what came before", path.display()));
                self.stop_reading();
            }
        }
        Ok(self.shown > before)
    }

    /// Shows all there is of the present file and takes leave of it.
    pub(super) fn show_rest(&mut self, screen: &mut dyn Screen, watcher: &dyn Watcher) -> anyhow::Result<()> {
        self.show_new(screen, watcher)?;
        match &self.path {
            Some(path) if !path.exists() => watcher.say(&format!("there is no recording {}", path.display())),
            Some(path) if !self.finished => {
                watcher.say(&format!("{} ends early; showing what it holds", path.display()));
            }
            _ => {}
        }
        self.stop_reading();
        Ok(())
    }

    /// Where the text of an event about this node belongs: at its latest message.
    pub(super) fn place(&self) -> Place {
        self.place_at(self.end.step.saturating_sub(1).max(self.start.step), self.end.epoch.saturating_sub(1))
    }

    fn place_at(&self, step: u64, epoch: u64) -> Place {
        Place { lane: self.lane.clone(), round: self.round, epoch: epoch.max(self.start.epoch), step }
    }

    fn stop_reading(&mut self) {
        (self.reader, self.path, self.finished) = (None, None, true);
    }

    fn read(&mut self, path: &Path, screen: &mut dyn Screen, watcher: &dyn Watcher) -> Result<(), Trouble> {
        if self.finished {
            return Ok(());
        }
        let mut reader = match self.reader.take() {
            Some(reader) => reader,
            // Announced before it is made.
            None if !path.exists() => return Ok(()),
            None => Reader::open(path).map_err(Trouble::Recording)?,
        };
        while !watcher.stop() {
            match reader.poll().map_err(Trouble::Recording)? {
                Polled::Message(_) if self.skip > 0 => self.skip -= 1,
                Polled::Message(raw) => {
                    self.shown += 1;
                    if let Some(message) = Message::decode(&raw).map_err(Trouble::Recording)? {
                        self.show(&message, screen).map_err(Trouble::Screen)?;
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

    fn show(&mut self, message: &Message, screen: &mut dyn Screen) -> anyhow::Result<()> {
        let step = self.start.step.saturating_add(message.at.step);
        let epoch = self.start.epoch.saturating_add(u64::from(message.at.epoch));
        self.end = self.end.later(Offset { step: step.saturating_add(1), epoch: epoch.saturating_add(1) });
        screen.show(&self.place_at(step, epoch), message)
    }
}

enum Trouble {
    Recording(anyhow::Error),
    Screen(anyhow::Error),
}
