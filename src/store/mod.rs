//! The store: results and recordings by the digest of their bytes, and entries that say which key made them.
//!
//! Only this module writes under `objects/` and `keys/`. What a name points to never changes, a file appears whole or
//! not at all, and an entry appears after everything it names.

mod durable;
mod entry;
mod lock;
mod objects;

use std::{
    fs,
    path::{Path, PathBuf},
    time::Duration,
};

use anyhow::{Context as _, bail};
use serde_json::json;

use crate::digest::Digest;

pub use durable::{replace, sync_folder};
pub use entry::{Draft, Entry, FileRef, Found, Published, RecordingRef};
pub(crate) use lock::mark_alive;
pub use lock::{KeyLock, StoreLock, is_held};
pub use objects::{Stat, Unusable};

/// The layout of a store; raised when an older carl-pipe would misread it.
const FORMAT: u64 = 1;

/// How long a run waits for a `gc` to end, or a `gc` for runs.
const PATIENCE: Duration = Duration::from_secs(30);

/// An open store.
#[derive(Debug)]
pub struct Store {
    root: PathBuf,
    _lock: StoreLock,
}

/// Another process held the store for too long.
#[derive(Debug)]
pub struct Busy(String);

impl std::fmt::Display for Busy {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}
impl std::error::Error for Busy {}

impl Store {
    /// Opens a store beside other runs; makes it where there is none.
    ///
    /// # Errors
    /// [`Busy`] while a `gc` holds it, a format of another carl-pipe, or what the system says.
    pub fn open(root: &Path) -> anyhow::Result<Self> {
        prepare(root)?;
        sweep_temporaries(root);
        let lock = StoreLock::shared(&root.join("lock"), PATIENCE)?
            .ok_or_else(|| Busy(format!("{} is being cleaned by another process", root.display())))?;
        Ok(Self { root: root.to_owned(), _lock: lock })
    }

    /// Opens a store alone, with no run beside.
    ///
    /// # Errors
    /// [`Busy`] while a run holds it, a format of another carl-pipe, or what the system says.
    pub fn open_alone(root: &Path) -> anyhow::Result<Self> {
        prepare(root)?;
        let lock = StoreLock::exclusive(&root.join("lock"), Duration::ZERO)?
            .ok_or_else(|| Busy(format!("{} is in use by a run", root.display())))?;
        Ok(Self { root: root.to_owned(), _lock: lock })
    }

    /// The folder of the store.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Where the runs lie.
    pub fn runs(&self) -> PathBuf {
        self.root.join("runs")
    }

    /// A folder for what is not yet published, in the file system of the store.
    pub fn temporary(&self) -> PathBuf {
        self.root.join("tmp")
    }

    /// Where the object of a digest lies, whether or not it is there.
    pub fn object(&self, digest: Digest) -> PathBuf {
        self.root.join(object_below_root(digest))
    }

    /// The lock of a key, or `None` while another process works on it.
    ///
    /// # Errors
    /// What the system says.
    pub fn try_lock(&self, key: Digest) -> anyhow::Result<Option<KeyLock>> {
        KeyLock::try_take(&self.root.join("locks").join(key.hex()))
    }
}

/// The path of an object below the root of the store.
pub fn object_below_root(digest: Digest) -> PathBuf {
    let hex = digest.hex();
    Path::new("objects").join(&hex[..2]).join(&hex[2..])
}

/// Makes the folders of a store and refuses a layout of another version.
fn prepare(root: &Path) -> anyhow::Result<()> {
    let marker = root.join("store.json");
    match fs::read(&marker) {
        Ok(bytes) => {
            let format =
                serde_json::from_slice::<serde_json::Value>(&bytes).ok().and_then(|json| json["format"].as_u64());
            match format {
                Some(FORMAT) => Ok(()),
                Some(other) => bail!(
                    "{} is a store of format {other}, but this carl-pipe reads format {FORMAT}; give another folder with `--artifacts`",
                    root.display()
                ),
                None => write_marker(root, &marker),
            }
        }
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            for folder in ["objects", "keys", "runs", "locks", "tmp", "bad"] {
                let folder = root.join(folder);
                fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
            }
            write_marker(root, &marker)
        }
        Err(error) => Err(error).with_context(|| format!("cannot read {}", marker.display())),
    }
}

fn write_marker(root: &Path, marker: &Path) -> anyhow::Result<()> {
    let text = format!("{}\n", json!({"store": "carl-pipe", "format": FORMAT}));
    replace(marker, text.as_bytes(), true).with_context(|| format!("cannot make a store in {}", root.display()))
}

/// Removes what killed processes left half written, if no process uses the store now.
fn sweep_temporaries(root: &Path) {
    let folder = root.join("tmp");
    let is_empty = fs::read_dir(&folder).map_or(true, |mut items| items.next().is_none());
    if is_empty {
        return;
    }
    // Whoever else is alive keeps a shared lock; a failure here costs space, never a result.
    if let Ok(Some(_alone)) = StoreLock::exclusive(&root.join("lock"), Duration::ZERO) {
        for item in fs::read_dir(&folder).into_iter().flatten().flatten() {
            let path = item.path();
            let _ = if path.is_dir() { fs::remove_dir_all(&path) } else { fs::remove_file(&path) };
        }
    }
}
