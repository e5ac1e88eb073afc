//! Shows whether the process of a run lives: it holds a lock that the kernel frees when the process dies.

use std::{
    fs::{File, OpenOptions, TryLockError},
    io,
    path::Path,
};

/// Marks a run as alive for as long as the file that is returned stays open.
pub(super) fn mark(run_dir: &Path) -> io::Result<File> {
    let file = OpenOptions::new().write(true).create(true).truncate(false).open(run_dir.join("alive"))?;
    file.lock()?;
    Ok(file)
}

/// Whether a process holds the mark of a run.
pub(super) fn is_marked(run_dir: &Path) -> bool {
    let file = File::open(run_dir.join("alive"));
    file.is_ok_and(|file| matches!(file.try_lock_shared(), Err(TryLockError::WouldBlock)))
}
