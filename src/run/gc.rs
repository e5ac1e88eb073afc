//! Removes old runs, and the results that no kept run names.

use std::{fs, path::Path};

use anyhow::{Context as _, bail};
use serde::Serialize;

use super::{events::RunState, manifest::Manifest, runs, strays};
use crate::store::{Kept, LocalStore, ResultStore as _};

/// What a cleaning removes, or would remove.
#[derive(Debug, Default, Clone, PartialEq, Eq, Serialize)]
pub struct Cleaned {
    /// The ids of runs.
    pub runs: Vec<String>,
    /// How many entries.
    pub entries: usize,
    /// How many objects.
    pub objects: usize,
    /// Bytes of objects and of damaged files.
    pub bytes: u64,
}

/// Keeps the newest `keep_runs` runs and all results that they name. The store must be open alone, so that no run is
/// in progress. `dry_run` only counts.
///
/// # Errors
/// The manifest of a kept run cannot be read, or the system failed.
pub fn clean(store: &LocalStore, runs_folder: &Path, keep_runs: usize, dry_run: bool) -> anyhow::Result<Cleaned> {
    let ids = runs::list(runs_folder)?;
    let (kept_runs, dropped) = ids.split_at(keep_runs.min(ids.len()));
    let mut kept = Kept::default();
    if !dry_run {
        strays::sweep_links(runs_folder);
        kept_runs.iter().for_each(|id| strays::sweep_run(&runs_folder.join(id)));
    }
    for id in kept_runs {
        keep(&runs_folder.join(id), store, &mut kept)?;
    }
    for id in dropped.iter().filter(|_| !dry_run) {
        let run_dir = runs_folder.join(id);
        fs::remove_dir_all(&run_dir).with_context(|| format!("cannot remove {}", run_dir.display()))?;
    }
    let removed = store.clean(&kept, dry_run)?;
    Ok(Cleaned { runs: dropped.to_vec(), entries: removed.entries, objects: removed.objects, bytes: removed.bytes })
}

/// Keeps the results that a run names.
fn keep(run_dir: &Path, store: &LocalStore, kept: &mut Kept) -> anyhow::Result<()> {
    if !run_dir.join("manifest.json").exists() {
        return Ok(()); // The run was killed before its first node started, so it names nothing.
    }
    let manifest = match Manifest::read(run_dir) {
        Ok(manifest) => manifest,
        Err(error) => bail!("{error:#}; nothing is removed while it is unclear what the run names"),
    };
    for key in manifest.nodes.iter().filter_map(|record| record.outcome.key) {
        store.entry(key)?.iter().for_each(|entry| kept.add(entry));
    }
    if manifest.state == RunState::Running {
        // The run was killed, so its manifest lacks keys. The entries that it made name the run.
        store.entries()?.iter().filter(|entry| entry.run == manifest.run).for_each(|entry| kept.add(entry));
    }
    Ok(())
}
