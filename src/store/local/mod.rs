//! A store in a folder. Only this module writes under `objects/` and `keys/`.

mod clean;
mod durable;
mod find;
mod lock;
mod marker;
mod objects;
mod publish;
mod verify;

use std::{
    fs,
    path::{Path, PathBuf},
    time::Duration,
};

use super::{Entry, Error, FileRef, Holder, KeyLock, Lookup, NewEntry, Published, Result, ResultStore, holder};
use crate::digest::Digest;

pub use clean::{Kept, Removed};
use durable::OWN_PREFIX;
pub use durable::{own_items, replace_file, sync_folder};
use lock::{LockedKey, StoreLock};
use marker::Place;
pub use verify::{Fault, Inventory};

/// How long a run waits until the cleaning of a store ends.
const PATIENCE: Duration = Duration::from_secs(30);

/// An open store in a folder. Several processes may have it open at once.
#[derive(Debug)]
pub struct LocalStore {
    root: PathBuf,
    scratch: PathBuf,
    /// False for a store that is only read: then nothing in its folder is made, changed or removed.
    may_write: bool,
    /// `None` where a reader found no lock that it could open.
    _lock: Option<StoreLock>,
}

impl LocalStore {
    /// Opens a store that other processes may use at the same time; makes it in an empty or absent folder.
    ///
    /// # Errors
    /// [`Error::Busy`] while another process cleans the store, [`Error::NotAStore`] for a folder with other files,
    /// [`Error::OtherFormat`], or the system refused an operation.
    pub fn open(root: &Path) -> Result<Self> {
        marker::make(root, marker::look(root)?)?;
        sweep_scratch(root);
        let lock = StoreLock::shared(&root.join("lock"), PATIENCE)?;
        let lock = lock.ok_or_else(|| busy(root, "is being cleaned"))?;
        Ok(Self::with(root, true, Some(lock)))
    }

    /// Opens a store for reading, also where this process may not write. An empty or absent folder is an empty store.
    ///
    /// # Errors
    /// [`Error::Busy`] while another process cleans the store, [`Error::NotAStore`] for a folder with other files,
    /// [`Error::OtherFormat`], or the system refused an operation.
    pub fn open_to_read(root: &Path) -> Result<Self> {
        let lock = match marker::look(root)? {
            Place::Free => None,
            Place::Store => match StoreLock::of_reader(&root.join("lock"), PATIENCE)? {
                Some(lock) => lock,
                None => return Err(busy(root, "is being cleaned")),
            },
        };
        Ok(Self::with(root, false, lock))
    }

    /// Opens a store that no other process uses.
    ///
    /// # Errors
    /// [`Error::Busy`] while another process uses the store, [`Error::NotAStore`] for a folder that is no store,
    /// [`Error::OtherFormat`], or the system refused an operation.
    pub fn open_alone(root: &Path) -> Result<Self> {
        if marker::look(root)? == Place::Free {
            return Err(Error::NotAStore { folder: root.to_owned(), why: "it is empty" });
        }
        marker::make(root, Place::Store)?;
        let lock = StoreLock::exclusive(&root.join("lock"), Duration::ZERO)?;
        let lock = lock.ok_or_else(|| busy(root, "is in use"))?;
        Ok(Self::with(root, true, Some(lock)))
    }

    fn with(root: &Path, may_write: bool, lock: Option<StoreLock>) -> Self {
        Self { root: root.to_owned(), scratch: root.join("tmp"), may_write, _lock: lock }
    }

    /// The folder of the store.
    pub fn root(&self) -> &Path {
        &self.root
    }

    fn object(&self, digest: Digest) -> PathBuf {
        self.root.join(object_below_root(digest))
    }

    fn lock_path(&self, key: Digest) -> PathBuf {
        self.root.join("locks").join(key.hex())
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
        let lock = LockedKey::try_take(&self.lock_path(key))?;
        Ok(lock.map(|lock| Box::new(lock) as Box<dyn KeyLock>))
    }

    fn holder(&self, key: Digest) -> Option<Holder> {
        holder::holders(&self.lock_path(key)).first().copied()
    }

    fn scratch_path(&self, name: &str) -> PathBuf {
        self.scratch.join(format!("{OWN_PREFIX}{name}"))
    }

    fn path_of(&self, object: Digest) -> Option<PathBuf> {
        Some(self.object(object))
    }
}

/// The error that other processes hold the lock of a store. Names them where the system tells.
fn busy(root: &Path, why: &str) -> Error {
    let holders: Vec<String> = holder::holders(&root.join("lock")).iter().map(Holder::to_string).collect();
    let by = if holders.is_empty() { "another process".to_owned() } else { holders.join(", ") };
    Error::Busy(format!("{} {why} by {by}", root.display()))
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

/// Removes what killed processes left half written, if no process uses the store now.
fn sweep_scratch(root: &Path) {
    let own = || own_items(&root.join("tmp"));
    if own().next().is_none() {
        return;
    }
    // Every process that uses the store holds a shared lock. A failure here costs space, never a result.
    if let Ok(Some(_alone)) = StoreLock::exclusive(&root.join("lock"), Duration::ZERO) {
        for path in own() {
            let _ = if path.is_dir() { fs::remove_dir_all(&path) } else { fs::remove_file(&path) };
        }
    }
}
