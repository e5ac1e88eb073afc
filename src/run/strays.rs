//! Files that killed processes left in the folders of runs.

use std::{fs, path::Path};

use super::alive;
use crate::store;

/// How the name of a link begins that has not become `latest` yet; the id of its run follows.
pub(super) const FRESH_LINK: &str = ".latest-";

/// How the name of a run's folder begins until its file `alive` is locked; the id of the run follows.
pub(super) const FRESH_RUN: &str = ".new-";

/// Removes links that should have become `latest`, where the process of their run is dead. A failure costs a name, never
/// a result.
pub(super) fn sweep_links(runs_folder: &Path) {
    for item in fs::read_dir(runs_folder).into_iter().flatten().flatten() {
        let name = item.file_name();
        let run = name.to_str().and_then(|name| name.strip_prefix(FRESH_LINK));
        let is_link = item.file_type().is_ok_and(|kind| kind.is_symlink());
        if let Some(run) = run.filter(|run| is_link && !alive::is_marked(&runs_folder.join(run))) {
            let _ = fs::remove_file(runs_folder.join(format!("{FRESH_LINK}{run}")));
        }
    }
}

/// Removes half-written files from the folder of a run whose process is dead.
pub(super) fn sweep_run(run_dir: &Path) {
    if !alive::is_marked(run_dir) {
        store::own_items(run_dir).for_each(|path| drop(fs::remove_file(path)));
    }
}
