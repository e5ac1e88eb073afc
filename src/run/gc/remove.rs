//! Removes what a plan says.

use std::{fs, io, path::Path};

use anyhow::Context as _;

use super::{Plan, RemovedRun, kept};
use crate::{
    failpoint::failpoint,
    run::{runs, strays},
    store::{LocalStore, sync_folder},
};

/// The name of the folder of a run that is being removed begins so.
const GONE: &str = ".gone-";

/// Removes what a plan says. The store must be open alone, and the plan made since: no run may be in progress.
///
/// # Errors
/// The system refused an operation. The next cleaning removes what is left.
pub fn remove(store: &LocalStore, runs: &Path, plan: &Plan) -> anyhow::Result<()> {
    for RemovedRun { run, .. } in &plan.removed {
        let path = runs.join(run);
        let gone = runs.join(format!("{GONE}{run}"));
        failpoint!("rename run", fs::rename(&path, &gone))
            .with_context(|| format!("cannot remove {}", path.display()))?;
    }
    if !plan.removed.is_empty() {
        point_latest(runs)?;
        // Before a result goes, so that no power cut brings back a run without its results.
        sync_folder(runs)?;
    }
    store.clean(&kept(&plan.kept_entries), false)?;
    strays::sweep_links(runs);
    plan.kept.iter().for_each(|kept| strays::sweep_run(&runs.join(&kept.run)));
    sweep(runs)
}

/// Removes the folders that this or an earlier cleaning has renamed, and the folders of runs that were killed before
/// their folders had names.
fn sweep(runs: &Path) -> anyhow::Result<()> {
    let items = match fs::read_dir(runs) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
        items => items.with_context(|| format!("cannot read {}", runs.display()))?,
    };
    for path in items.flatten().map(|item| item.path()) {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if [GONE, strays::FRESH_RUN].iter().any(|begin| name.strip_prefix(begin).is_some_and(runs::is_id)) {
            failpoint!("remove run", fs::remove_dir_all(&path))
                .with_context(|| format!("cannot remove {}", path.display()))?;
        }
    }
    Ok(())
}

/// Lets `latest` point to the newest run that is left, where it points to none.
fn point_latest(runs: &Path) -> anyhow::Result<()> {
    let latest = runs.join("latest");
    if latest.exists() || fs::symlink_metadata(&latest).is_err() {
        return Ok(());
    }
    match runs::list(runs)?.first() {
        Some(newest) => runs::point_latest(runs, &newest.id),
        None => fs::remove_file(&latest).with_context(|| format!("cannot remove {}", latest.display())),
    }
}
