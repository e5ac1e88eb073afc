//! Removes what no kept run names: entries first, then objects, so that a kill half-way loses nothing kept.

use std::{
    collections::BTreeSet,
    fs,
    path::{Path, PathBuf},
};

use anyhow::{Context as _, bail};
use serde::Serialize;

use super::{manifest::Manifest, runs};
use crate::digest::Digest;
use crate::store::{Entry, Store, object_below_root};

/// What a cleaning removes, or would.
#[derive(Debug, Default, Clone, PartialEq, Eq, Serialize)]
pub struct Cleaned {
    /// Runs.
    pub runs: Vec<String>,
    /// Entries.
    pub entries: usize,
    /// Objects.
    pub objects: usize,
    /// Bytes of objects and of damaged files.
    pub bytes: u64,
}

/// Keeps the newest `keep_runs` runs and all that they name. The store must be open alone, which is why no run can be
/// under way; `dry_run` only counts.
///
/// # Errors
/// A kept run whose manifest cannot be read, or what the system says.
pub fn clean(store: &Store, keep_runs: usize, dry_run: bool) -> anyhow::Result<Cleaned> {
    let ids = runs::list(&store.runs())?;
    let (kept, dropped) = ids.split_at(keep_runs.min(ids.len()));
    let (mut keys, mut objects) = (BTreeSet::new(), BTreeSet::new());
    for id in kept {
        let run_dir = store.runs().join(id);
        if !run_dir.join("manifest.json").exists() {
            continue; // Killed before its first node: it names nothing.
        }
        let manifest = match Manifest::read(&run_dir) {
            Ok(manifest) => manifest,
            Err(error) => bail!("{error:#}; nothing is removed while it is unclear what the run names"),
        };
        for entry in entries_of(store, &manifest)? {
            keys.insert(entry.key_digest);
            objects.extend(entry.files.iter().map(|file| file.object));
            objects.extend(entry.recording.map(|recording| recording.object));
        }
    }
    let mut cleaned = Cleaned { runs: dropped.to_vec(), ..Cleaned::default() };
    for id in dropped {
        remove_all(&store.runs().join(id), dry_run)?;
    }
    let root = store.root();
    let kept_entries: BTreeSet<PathBuf> = keys.iter().map(|key| entry_below_root(*key)).collect();
    for path in files_below(root, "keys")?.into_iter().filter(|path| !kept_entries.contains(path)) {
        cleaned.entries += 1;
        remove(&root.join(path), dry_run)?;
    }
    let kept_objects: BTreeSet<PathBuf> = objects.iter().map(|object| object_below_root(*object)).collect();
    for path in files_below(root, "objects")?.into_iter().filter(|path| !kept_objects.contains(path)) {
        cleaned.objects += 1;
        cleaned.bytes += remove(&root.join(path), dry_run)?;
    }
    for folder in ["bad", "tmp", "locks"] {
        for item in fs::read_dir(root.join(folder)).into_iter().flatten().flatten() {
            cleaned.bytes += item.metadata().map_or(0, |meta| meta.len());
            remove_all(&item.path(), dry_run)?;
        }
    }
    Ok(cleaned)
}

/// The entries that a run names. A run that was killed knows no keys yet: then every entry that it made is found by
/// the run's id.
fn entries_of(store: &Store, manifest: &Manifest) -> anyhow::Result<Vec<Entry>> {
    let mut entries = Vec::new();
    for key in manifest.nodes.iter().filter_map(|node| node.key) {
        entries.extend(store.entry(key)?);
    }
    if manifest.state == super::events::RunState::Running {
        for path in files_below(store.root(), "keys")? {
            let hex: String = path.iter().skip(1).map(|part| part.to_string_lossy()).collect();
            let key = format!("b3:{}", hex.trim_end_matches(".json")).parse::<Digest>();
            let entry = key.ok().map(|key| store.entry(key)).transpose()?.flatten();
            entries.extend(entry.filter(|entry| entry.run == manifest.run));
        }
    }
    Ok(entries)
}

fn entry_below_root(key: Digest) -> PathBuf {
    let hex = key.hex();
    Path::new("keys").join(&hex[..2]).join(format!("{}.json", &hex[2..]))
}

/// Every file two levels below a folder of the store.
fn files_below(root: &Path, folder: &str) -> anyhow::Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    let read = |path: &Path| fs::read_dir(path).with_context(|| format!("cannot read {}", path.display()));
    for prefix in read(&root.join(folder))? {
        let prefix = prefix?.path();
        if prefix.is_dir() {
            for item in read(&prefix)? {
                files.push(item?.path().strip_prefix(root).unwrap_or(&prefix).to_owned());
            }
        }
    }
    files.sort();
    Ok(files)
}

fn remove(path: &Path, dry_run: bool) -> anyhow::Result<u64> {
    let bytes = fs::symlink_metadata(path).map_or(0, |meta| meta.len());
    if !dry_run {
        fs::remove_file(path).with_context(|| format!("cannot remove {}", path.display()))?;
    }
    Ok(bytes)
}

fn remove_all(path: &Path, dry_run: bool) -> anyhow::Result<()> {
    if dry_run {
        return Ok(());
    }
    let removed = if path.is_dir() { fs::remove_dir_all(path) } else { fs::remove_file(path) };
    removed.with_context(|| format!("cannot remove {}", path.display()))
}
