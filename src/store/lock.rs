//! Locks that the kernel frees when their holder dies, however it dies.

#![allow(
    clippy::disallowed_methods,
    reason = "wall times are kept beside a run and name its folder; no key and no result holds one"
)]

use std::{
    fs::{self, File, OpenOptions, TryLockError},
    os::unix::fs::MetadataExt as _,
    path::{Path, PathBuf},
    thread::sleep,
    time::{Duration, Instant},
};

use anyhow::Context as _;

/// The lock of a whole store: shared by runs, exclusive for `gc`.
#[derive(Debug)]
pub struct StoreLock {
    _file: File,
}

impl StoreLock {
    pub(super) fn shared(path: &Path, patience: Duration) -> anyhow::Result<Option<Self>> {
        Self::take(path, patience, File::try_lock_shared)
    }

    pub(super) fn exclusive(path: &Path, patience: Duration) -> anyhow::Result<Option<Self>> {
        Self::take(path, patience, File::try_lock)
    }

    fn take(
        path: &Path,
        patience: Duration,
        attempt: fn(&File) -> Result<(), TryLockError>,
    ) -> anyhow::Result<Option<Self>> {
        let file = open(path)?;
        let start = Instant::now();
        loop {
            match attempt(&file) {
                Ok(()) => return Ok(Some(Self { _file: file })),
                Err(TryLockError::WouldBlock) if start.elapsed() >= patience => return Ok(None),
                Err(TryLockError::WouldBlock) => sleep(Duration::from_millis(20)),
                Err(TryLockError::Error(error)) => {
                    return Err(error).with_context(|| format!("cannot lock {}", path.display()));
                }
            }
        }
    }
}

/// The right to work on one key; its file goes with it.
#[derive(Debug)]
pub struct KeyLock {
    path: PathBuf,
    _file: File,
}

impl KeyLock {
    pub(super) fn try_take(path: &Path) -> anyhow::Result<Option<Self>> {
        loop {
            let file = open(path)?;
            match file.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => return Ok(None),
                Err(TryLockError::Error(error)) => {
                    return Err(error).with_context(|| format!("cannot lock {}", path.display()));
                }
            }
            // The holder before us may have removed the file between our opening and our locking it.
            let ours = file.metadata().with_context(|| format!("cannot lock {}", path.display()))?.ino();
            if fs::metadata(path).is_ok_and(|named| named.ino() == ours) {
                return Ok(Some(Self { path: path.to_owned(), _file: file }));
            }
        }
    }
}

impl Drop for KeyLock {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.path);
    }
}

/// Takes the lock that shows a run as alive.
pub(crate) fn mark_alive(path: &Path) -> anyhow::Result<File> {
    let file = open(path)?;
    file.lock().with_context(|| format!("cannot lock {}", path.display()))?;
    Ok(file)
}

/// True while some process holds the lock of `path`.
pub fn is_held(path: &Path) -> bool {
    File::open(path).is_ok_and(|file| matches!(file.try_lock_shared(), Err(TryLockError::WouldBlock)))
}

fn open(path: &Path) -> anyhow::Result<File> {
    OpenOptions::new()
        .write(true)
        .create(true)
        .truncate(false)
        .open(path)
        .with_context(|| format!("cannot open {}", path.display()))
}
