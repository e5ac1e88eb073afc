//! Publishes results: first every object, made safe from a power cut, then the entry that names them.

use std::collections::BTreeSet;

use super::{
    LocalStore,
    durable::{make_folder, sync_folder},
    objects::{Placed, Staged},
};
use crate::store::{Entry, FileRef, Lookup, NewEntry, Published, RecordingRef, Result};

impl LocalStore {
    pub(super) fn publish_entry(&self, new: &NewEntry<'_>) -> Result<Published> {
        let mut entry = self.publish_objects(new)?;
        let path = self.entry_path(entry.key_digest);
        let folder = path.parent().expect("an entry lies in a folder").to_owned();
        make_folder(&folder)?;
        let file = self.write_entry(&entry, &new.key.json)?;
        file.seal()?;
        if file.place(&path)? {
            sync_folder(&folder)?;
            return Ok(Published { entry, differs: None });
        }
        let first = self.read_entry(entry.key_digest)?.entry();
        let differs = first.as_ref().map(|first| first.output).filter(|&output| output != entry.output);
        if differs.is_some()
            && let Lookup::Hit(first) = self.find_key(entry.key_digest)?
        {
            return Ok(Published { entry: *first, differs: Some(entry.output) });
        }
        // The results are equal, or the first one is damaged. The new entry replaces the first one, and keeps a
        // recording that only the first one has.
        if let Some(first) = first.filter(|_| differs.is_none()) {
            (entry.node, entry.run) = (first.node, first.run);
            entry.recording = entry.recording.or(first.recording);
        }
        let file = self.write_entry(&entry, &new.key.json)?;
        file.seal()?;
        file.replace(&path)?;
        sync_folder(&folder)?;
        Ok(Published { entry, differs })
    }

    fn publish_objects(&self, new: &NewEntry<'_>) -> Result<Entry> {
        let staged: Vec<Staged> = new.files.iter().map(|(_, content)| self.stage(content)).collect::<Result<_>>()?;
        let recording = new.recording.map(|recording| self.stage_file(recording.file)).transpose()?;
        staged.iter().chain(&recording).try_for_each(Staged::seal)?;
        let mut folders = BTreeSet::new();
        let mut place = |object: Staged| {
            let placed = object.place()?;
            folders.insert(placed.folder.clone());
            Ok(placed)
        };
        let mut files = Vec::new();
        for ((name, _), object) in new.files.iter().zip(staged) {
            let Placed { digest, stat, .. } = place(object)?;
            files.push(FileRef { name: name.to_owned(), object: digest, stat });
        }
        let recording = recording.map(place).transpose()?;
        let recording = recording.zip(new.recording).map(|(placed, recording)| RecordingRef {
            object: placed.digest,
            messages: recording.messages,
            stat: placed.stat,
        });
        folders.iter().try_for_each(|folder| sync_folder(folder))?;
        Ok(Entry::new(new, files, recording))
    }
}
