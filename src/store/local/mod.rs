//! A store in a folder. Only this module writes under `objects/` and `keys/`.

mod clean;
mod durable;
mod find;
mod lock;
mod objects;
mod publish;

use std::{
    fs,
    path::{Path, PathBuf},
    time::Duration,
};

use serde_json::json;

use super::{Entry, Error, FileRef, KeyLock, Lookup, NewEntry, Published, Result, ResultStore, error::OrIo as _};
use crate::digest::Digest;

pub use clean::{Kept, Removed};
pub use durable::replace_file;
use lock::{LockedKey, StoreLock};

/// The layout of a store. Raise it when an older carl-pipe would misread a store.
const FORMAT: u64 = 1;

/// How long a run waits until the cleaning of a store ends.
const PATIENCE: Duration = Duration::from_secs(30);

/// An open store in a folder. Several processes may have it open at once.
#[derive(Debug)]
pub struct LocalStore {
    root: PathBuf,
    scratch: PathBuf,
    _lock: StoreLock,
}

impl LocalStore {
    /// Opens a store that other processes may use at the same time; makes it where there is none.
    ///
    /// # Errors
    /// [`Error::Busy`] while another process cleans the store, [`Error::OtherFormat`], or the system refused an
    /// operation.
    pub fn open(root: &Path) -> Result<Self> {
        prepare(root)?;
        sweep_scratch(root);
        let lock = StoreLock::shared(&root.join("lock"), PATIENCE)?;
        Self::locked(root, lock.ok_or_else(|| busy(root, "is being cleaned by another process")))
    }

    /// Opens a store that no other process uses.
    ///
    /// # Errors
    /// [`Error::Busy`] while another process uses the store, [`Error::OtherFormat`], or the system refused an
    /// operation.
    pub fn open_alone(root: &Path) -> Result<Self> {
        prepare(root)?;
        let lock = StoreLock::exclusive(&root.join("lock"), Duration::ZERO)?;
        Self::locked(root, lock.ok_or_else(|| busy(root, "is in use by a run")))
    }

    fn locked(root: &Path, lock: Result<StoreLock>) -> Result<Self> {
        Ok(Self { root: root.to_owned(), scratch: root.join("tmp"), _lock: lock? })
    }

    /// The folder of the store.
    pub fn root(&self) -> &Path {
        &self.root
    }

    fn object(&self, digest: Digest) -> PathBuf {
        self.root.join(object_below_root(digest))
    }

    fn entry_path(&self, key: Digest) -> PathBuf {
        self.root.join(entry_below_root(key))
    }
}

impl ResultStore for LocalStore {
    fn find(&self, key: Digest) -> Result<Lookup> {
        self.find_key(key)
    }

    fn entry(&self, key: Digest) -> Result<Option<Entry>> {
        Ok(self.read_entry(key)?.entry())
    }

    fn read(&self, file: &FileRef) -> Result<Vec<u8>> {
        self.read_object(file.object)?.map_err(|problem| problem.of(&file.name))
    }

    fn open(&self, file: &FileRef) -> Result<PathBuf> {
        match self.verify(file.object)? {
            None => Ok(self.object(file.object)),
            Some(problem) => Err(problem.of(&file.name)),
        }
    }

    fn publish(&self, new: NewEntry<'_>) -> Result<Published> {
        self.publish_entry(&new)
    }

    fn try_lock(&self, key: Digest) -> Result<Option<Box<dyn KeyLock>>> {
        let lock = LockedKey::try_take(&self.root.join("locks").join(key.hex()))?;
        Ok(lock.map(|lock| Box::new(lock) as Box<dyn KeyLock>))
    }

    fn scratch(&self) -> &Path {
        &self.scratch
    }

    fn path_of(&self, object: Digest) -> Option<PathBuf> {
        Some(self.object(object))
    }
}

fn busy(root: &Path, why: &str) -> Error {
    Error::Busy(format!("{} {why}", root.display()))
}

/// The path of an object below the folder of the store.
fn object_below_root(digest: Digest) -> PathBuf {
    let hex = digest.hex();
    Path::new("objects").join(&hex[..2]).join(&hex[2..])
}

/// The path of an entry below the folder of the store.
fn entry_below_root(key: Digest) -> PathBuf {
    let hex = key.hex();
    Path::new("keys").join(&hex[..2]).join(format!("{}.json", &hex[2..]))
}

/// Makes the folders of a store, and refuses a layout of another version.
fn prepare(root: &Path) -> Result<()> {
    let marker = root.join("store.json");
    match fs::read(&marker) {
        Ok(bytes) => {
            let format =
                serde_json::from_slice::<serde_json::Value>(&bytes).ok().and_then(|json| json["format"].as_u64());
            match format {
                Some(FORMAT) => Ok(()),
                Some(found) => Err(Error::OtherFormat { folder: root.to_owned(), found, supported: FORMAT }),
                None => write_marker(&marker),
            }
        }
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            for folder in ["objects", "keys", "locks", "tmp", "bad"] {
                let folder = root.join(folder);
                fs::create_dir_all(&folder).or_io(|| format!("cannot make {}", folder.display()))?;
            }
            write_marker(&marker)
        }
        Err(error) => Err(error).or_io(|| format!("cannot read {}", marker.display())),
    }
}

fn write_marker(marker: &Path) -> Result<()> {
    let text = format!("{}\n", json!({"store": "carl-pipe", "format": FORMAT}));
    replace_file(marker, text.as_bytes(), true)
}

/// Removes what killed processes left half written, if no process uses the store now.
fn sweep_scratch(root: &Path) {
    let folder = root.join("tmp");
    let is_empty = fs::read_dir(&folder).map_or(true, |mut items| items.next().is_none());
    if is_empty {
        return;
    }
    // Every process that uses the store holds a shared lock. A failure here costs space, never a result.
    if let Ok(Some(_alone)) = StoreLock::exclusive(&root.join("lock"), Duration::ZERO) {
        for item in fs::read_dir(&folder).into_iter().flatten().flatten() {
            let path = item.path();
            let _ = if path.is_dir() { fs::remove_dir_all(&path) } else { fs::remove_file(&path) };
        }
    }
}
