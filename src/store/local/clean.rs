//! Removes what is no longer wanted: entries first, then objects, so that a kill half-way loses nothing wanted.

use std::{
    collections::BTreeSet,
    fs, io,
    path::{Path, PathBuf},
};

use super::{LocalStore, durable::own_items, entry_below_root, object_below_root};
use crate::{
    digest::Digest,
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
        self.objects.extend(entry.files.iter().map(|file| file.object));
        self.objects.extend(entry.recording.as_ref().map(|recording| recording.object));
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
        let entries: BTreeSet<PathBuf> = kept.keys.iter().map(|key| entry_below_root(*key)).collect();
        for path in self.files_below("keys")?.into_iter().filter(|path| !entries.contains(path)) {
            removed.entries += 1;
            remove_file(&self.root.join(path), dry_run)?;
        }
        let objects: BTreeSet<PathBuf> = kept.objects.iter().map(|object| object_below_root(*object)).collect();
        for path in self.files_below("objects")?.into_iter().filter(|path| !objects.contains(path)) {
            removed.objects += 1;
            removed.bytes += remove_file(&self.root.join(path), dry_run)?;
        }
        let temporary = ["bad", "tmp"].into_iter().flat_map(|folder| own_items(&self.root.join(folder)));
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
        for path in self.files_below("keys")? {
            if let Some(key) = digest_of(&path) {
                entries.extend(self.read_entry(key)?.entry());
            }
        }
        Ok(entries)
    }

    /// The lock files of keys.
    fn locks(&self) -> impl Iterator<Item = PathBuf> {
        let items = fs::read_dir(self.root.join("locks")).into_iter().flatten().flatten();
        let is_lock = |item: &fs::DirEntry| digest_of(&Path::new("locks").join(item.file_name())).is_some();
        items.filter(is_lock).map(|item| item.path())
    }

    /// Every entry or object below a folder of the store, relative to the store. Files of other names are not ours.
    fn files_below(&self, folder: &str) -> Result<Vec<PathBuf>> {
        let mut files = Vec::new();
        for prefix in paths_in(&self.root.join(folder))? {
            if prefix.is_dir() {
                let paths = paths_in(&prefix)?;
                let below = paths.iter().filter_map(|path| path.strip_prefix(&self.root).ok());
                files.extend(below.filter(|path| digest_of(path).is_some()).map(Path::to_owned));
            }
        }
        files.sort();
        Ok(files)
    }
}

/// The digest that the path of an entry, an object or a lock, relative to the store, spells out.
fn digest_of(path: &Path) -> Option<Digest> {
    let hex: String = path.iter().skip(1).map(|part| part.to_string_lossy()).collect();
    format!("b3:{}", hex.strip_suffix(".json").unwrap_or(&hex)).parse().ok()
}

fn paths_in(folder: &Path) -> Result<Vec<PathBuf>> {
    let paths = fs::read_dir(folder).and_then(|items| items.map(|item| Ok(item?.path())).collect());
    if paths.as_ref().is_err_and(|error: &io::Error| error.kind() == io::ErrorKind::NotFound) {
        return Ok(Vec::new());
    }
    paths.or_io(|| format!("cannot read {}", folder.display()))
}

fn remove_file(path: &Path, dry_run: bool) -> Result<u64> {
    let bytes = fs::symlink_metadata(path).map_or(0, |meta| meta.len());
    if !dry_run {
        fs::remove_file(path).or_io(|| format!("cannot remove {}", path.display()))?;
    }
    Ok(bytes)
}

fn remove_any(path: &Path, dry_run: bool) -> Result<()> {
    if dry_run {
        return Ok(());
    }
    let removed = if path.is_dir() { fs::remove_dir_all(path) } else { fs::remove_file(path) };
    removed.or_io(|| format!("cannot remove {}", path.display()))
}
