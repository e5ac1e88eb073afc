//! Looks entries up.

use std::{fs, io};

use serde_json::Value;

use super::{LocalStore, durable::Temporary, objects::ObjectState};
use crate::{
    digest::Digest,
    failpoint::failpoint,
    store::{Entry, Lookup, Result, entry::EntryFault, error::OrIo as _},
};

/// What lies where the entry of a key belongs.
pub(super) enum EntryOnDisk {
    Whole(Box<Entry>),
    Missing,
    Unusable(EntryFault),
}

impl EntryOnDisk {
    pub(super) fn entry(self) -> Option<Entry> {
        match self {
            Self::Whole(entry) => Some(*entry),
            Self::Missing | Self::Unusable(_) => None,
        }
    }
}

impl LocalStore {
    pub(super) fn find_key(&self, key: Digest) -> Result<Lookup> {
        match self.read_entry(key)? {
            EntryOnDisk::Whole(entry) => self.check(entry),
            EntryOnDisk::Missing => Ok(Lookup::Miss),
            EntryOnDisk::Unusable(why) => {
                self.set_aside(&self.entry_path(key));
                Ok(Lookup::Unusable(why.to_string()))
            }
        }
    }

    /// Compares every object of an entry with what the entry says about it.
    fn check(&self, mut entry: Box<Entry>) -> Result<Lookup> {
        let mut was_moved = false;
        for file in &mut entry.files {
            match self.look_at(file.object, file.stat)? {
                ObjectState::Same => {}
                ObjectState::Moved(stat) => (file.stat, was_moved) = (stat, true),
                ObjectState::Unusable(problem) => {
                    return Ok(Lookup::Unusable(format!("its {} is {problem}", file.name)));
                }
            }
        }
        if let Some(recording) = &mut entry.recording {
            match self.look_at(recording.object, recording.stat)? {
                ObjectState::Same => {}
                ObjectState::Moved(stat) => (recording.stat, was_moved) = (stat, true),
                // The result can be used without its recording.
                ObjectState::Unusable(_) => (entry.recording, entry.lost_recording) = (None, true),
            }
        }
        if was_moved && !entry.lost_recording && self.may_write {
            // The new entry spares the next look-up from reading the objects. A failure changes no answer.
            let path = self.entry_path(entry.key_digest);
            let key = Entry::key_in(&fs::read(&path).unwrap_or_default());
            let _ = self.write_entry(&entry, &key).and_then(|file| file.replace(&path));
        }
        Ok(Lookup::Hit(entry))
    }

    pub(super) fn read_entry(&self, key: Digest) -> Result<EntryOnDisk> {
        let path = self.entry_path(key);
        match failpoint!("read entry", fs::read(&path)) {
            Ok(text) => Ok(match Entry::from_text(&text, key) {
                Ok(entry) => EntryOnDisk::Whole(Box::new(entry)),
                Err(why) => EntryOnDisk::Unusable(why),
            }),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(EntryOnDisk::Missing),
            Err(error) => Err(error).or_io(|| format!("cannot read {}", path.display())),
        }
    }

    /// Writes an entry to a file that does not have its name yet.
    pub(super) fn write_entry(&self, entry: &Entry, key: &Value) -> Result<Temporary> {
        let text = entry.to_text(key).or_io(|| "cannot write an entry".to_owned())?;
        Temporary::write(&self.scratch, &[text.as_bytes()])
    }
}
