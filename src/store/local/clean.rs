//! Removes what is no longer wanted: entries first, then objects, so that a kill half-way loses nothing wanted.

use std::{
    collections::BTreeSet,
    fs,
    path::{Path, PathBuf},
};

use super::{LocalStore, durable::own_items, verify::Inventory};
use crate::{
    digest::Digest,
    failpoint::failpoint,
    store::{Entry, Result, error::OrIo as _},
};

/// What a cleaning keeps.
#[derive(Debug, Default)]
pub struct Kept {
    keys: BTreeSet<Digest>,
    objects: BTreeSet<Digest>,
}

impl Kept {
    /// Keeps an entry and all objects that it names.
    pub fn add(&mut self, entry: &Entry) {
        self.keys.insert(entry.key_digest);
        self.objects.extend(entry.objects());
    }
}

/// What a cleaning removes, or would remove.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
pub struct Removed {
    /// Entries.
    pub entries: usize,
    /// Objects.
    pub objects: usize,
    /// Bytes of objects and of files that were set aside.
    pub bytes: u64,
}

impl LocalStore {
    /// Removes all entries and objects but `kept`. The store must be open alone, so that no other process publishes
    /// meanwhile. `dry_run` only counts.
    ///
    /// # Errors
    /// The system refused an operation.
    pub fn clean(&self, kept: &Kept, dry_run: bool) -> Result<Removed> {
        let mut removed = Removed::default();
        let Inventory { keys, objects, .. } = self.whole_inventory()?;
        for key in keys.into_iter().filter(|key| !kept.keys.contains(key)) {
            removed.entries += 1;
            remove_file(&self.entry_path(key), dry_run)?;
        }
        for object in objects.into_iter().filter(|object| !kept.objects.contains(object)) {
            removed.objects += 1;
            removed.bytes += remove_file(&self.object(object), dry_run)?;
        }
        let temporary = ["bad", "tmp", ""].into_iter().flat_map(|folder| own_items(&self.root.join(folder)));
        for path in temporary.chain(self.locks()) {
            removed.bytes += fs::symlink_metadata(&path).map_or(0, |meta| meta.len());
            remove_any(&path, dry_run)?;
        }
        Ok(removed)
    }

    /// Every whole entry of the store.
    ///
    /// # Errors
    /// The system refused an operation.
    pub fn entries(&self) -> Result<Vec<Entry>> {
        let mut entries = Vec::new();
        for key in self.whole_inventory()?.keys {
            entries.extend(self.read_entry(key)?.entry());
        }
        Ok(entries)
    }

    /// What the store holds.
    ///
    /// # Errors
    /// A folder cannot be listed.
    fn whole_inventory(&self) -> Result<Inventory> {
        let mut inventory = self.inventory();
        match inventory.unlisted.pop() {
            Some((folder, source)) => Err(source).or_io(|| format!("cannot read {}", folder.display())),
            None => Ok(inventory),
        }
    }

    /// The lock files of keys.
    fn locks(&self) -> impl Iterator<Item = PathBuf> {
        let items = fs::read_dir(self.root.join("locks")).into_iter().flatten().flatten();
        let key = |item: &fs::DirEntry| format!("b3:{}", item.file_name().to_str()?).parse::<Digest>().ok();
        items.filter(move |item| key(item).is_some()).map(|item| item.path())
    }
}

fn remove_file(path: &Path, dry_run: bool) -> Result<u64> {
    let bytes = fs::symlink_metadata(path).map_or(0, |meta| meta.len());
    if !dry_run {
        failpoint!("remove entry or object", fs::remove_file(path))
            .or_io(|| format!("cannot remove {}", path.display()))?;
    }
    Ok(bytes)
}

fn remove_any(path: &Path, dry_run: bool) -> Result<()> {
    if dry_run {
        return Ok(());
    }
    let remove = || if path.is_dir() { fs::remove_dir_all(path) } else { fs::remove_file(path) };
    failpoint!("remove stray", remove()).or_io(|| format!("cannot remove {}", path.display()))
}
