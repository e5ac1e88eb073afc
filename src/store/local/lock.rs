//! File locks. The kernel frees a lock when its process dies, in whatever way.

#![allow(
    clippy::disallowed_methods,
    reason = "a clock limits how long to wait for a lock; no key or result holds a time"
)]

use std::{
    fs::{self, File, OpenOptions, TryLockError},
    io,
    os::unix::fs::MetadataExt as _,
    path::{Path, PathBuf},
    thread::sleep,
    time::{Duration, Instant},
};

use crate::{
    failpoint::failpoint,
    store::{KeyLock, Result, error::OrIo as _},
};

/// The lock of a whole store: shared by its users, exclusive for cleaning.
#[derive(Debug)]
pub(super) struct StoreLock {
    _file: File,
}

impl StoreLock {
    /// A shared lock, or `None` if it is not free within `patience`.
    pub(super) fn shared(path: &Path, patience: Duration) -> Result<Option<Self>> {
        Self::take(path, patience, File::try_lock_shared)
    }

    /// The exclusive lock, or `None` if it is not free within `patience`.
    pub(super) fn exclusive(path: &Path, patience: Duration) -> Result<Option<Self>> {
        Self::take(path, patience, File::try_lock)
    }

    /// A shared lock for a reader, who makes no file; `Some(None)` where there is no lock file that it may open, and
    /// `None` if the lock is not free within `patience`.
    pub(super) fn of_reader(path: &Path, patience: Duration) -> Result<Option<Option<Self>>> {
        match File::open(path) {
            Ok(file) => Ok(Self::take_file(file, path, patience, File::try_lock_shared)?.map(Some)),
            Err(_) => Ok(Some(None)),
        }
    }

    fn take(
        path: &Path,
        patience: Duration,
        attempt: fn(&File) -> std::result::Result<(), TryLockError>,
    ) -> Result<Option<Self>> {
        Self::take_file(failpoint!("lock store", open(path)).or_io(|| cannot_lock(path))?, path, patience, attempt)
    }

    fn take_file(
        file: File,
        path: &Path,
        patience: Duration,
        attempt: fn(&File) -> std::result::Result<(), TryLockError>,
    ) -> Result<Option<Self>> {
        let start = Instant::now();
        loop {
            match attempt(&file) {
                Ok(()) => return Ok(Some(Self { _file: file })),
                Err(TryLockError::WouldBlock) if start.elapsed() >= patience => return Ok(None),
                Err(TryLockError::WouldBlock) => sleep(Duration::from_millis(20)),
                Err(TryLockError::Error(error)) => return Err(error).or_io(|| cannot_lock(path)),
            }
        }
    }
}

/// The lock of one key. Dropping it removes its file.
#[derive(Debug)]
pub(super) struct LockedKey {
    path: PathBuf,
    _file: File,
}

impl KeyLock for LockedKey {}

impl LockedKey {
    /// The lock, or `None` while another process holds it.
    pub(super) fn try_take(path: &Path) -> Result<Option<Self>> {
        loop {
            let file = failpoint!("lock key", open(path)).or_io(|| cannot_lock(path))?;
            match file.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => return Ok(None),
                Err(TryLockError::Error(error)) => return Err(error).or_io(|| cannot_lock(path)),
            }
            // The previous holder may have removed the file after this process opened it and before it locked it.
            let ours = file.metadata().or_io(|| cannot_lock(path))?.ino();
            if fs::metadata(path).is_ok_and(|named| named.ino() == ours) {
                return Ok(Some(Self { path: path.to_owned(), _file: file }));
            }
        }
    }
}

impl Drop for LockedKey {
    fn drop(&mut self) {
        let _ = failpoint!("remove key lock", fs::remove_file(&self.path));
    }
}

fn cannot_lock(path: &Path) -> String {
    format!("cannot lock {}", path.display())
}

fn open(path: &Path) -> io::Result<File> {
    OpenOptions::new().write(true).create(true).truncate(false).open(path)
}
