//! Shows whether the process of a run lives: it holds a lock that the kernel frees when the process dies.

use std::{
    fs::{File, OpenOptions, TryLockError},
    path::Path,
};

use anyhow::Context as _;

use crate::failpoint::failpoint;

/// Marks a run as alive for as long as the file that is returned stays open.
pub(super) fn mark(run_dir: &Path) -> anyhow::Result<File> {
    let path = run_dir.join("alive");
    let file = failpoint!("mark alive", OpenOptions::new().write(true).create(true).truncate(false).open(&path));
    let file = file.with_context(|| format!("cannot open {}", path.display()))?;
    failpoint!("mark alive", file.lock()).with_context(|| format!("cannot lock {}", path.display()))?;
    Ok(file)
}

/// Whether a process holds the mark of a run.
pub(super) fn is_marked(run_dir: &Path) -> bool {
    let file = File::open(run_dir.join("alive"));
    file.is_ok_and(|file| matches!(file.try_lock_shared(), Err(TryLockError::WouldBlock)))
}
