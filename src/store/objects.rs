//! Bytes by their digest: written once, checked when used, put aside when damaged.

use std::{
    fs, io,
    os::unix::fs::MetadataExt as _,
    path::{Path, PathBuf},
};

use anyhow::Context as _;
use serde::{Deserialize, Serialize};

use super::{
    Store,
    durable::{Temporary, fresh_name, make_folder},
};
use crate::digest::Digest;

/// What tells an untouched file without reading it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Stat {
    /// Bytes.
    pub size: u64,
    /// Time of the last writing.
    pub mtime_ns: i64,
    /// Time of the last change of the file or its inode, which no tool can set back.
    pub ctime_ns: i64,
    /// The file's number in its file system.
    pub inode: u64,
}

impl Stat {
    pub(super) fn of(path: &Path) -> io::Result<Self> {
        let meta = fs::symlink_metadata(path)?;
        let ns = |secs: i64, nanos: i64| secs.saturating_mul(1_000_000_000).saturating_add(nanos);
        Ok(Self {
            size: meta.len(),
            mtime_ns: ns(meta.mtime(), meta.mtime_nsec()),
            ctime_ns: ns(meta.ctime(), meta.ctime_nsec()),
            inode: meta.ino(),
        })
    }
}

/// Why an object that an entry names cannot be used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Unusable {
    /// The object is not there.
    Gone,
    /// Its bytes are not what its name says; they now lie in `bad/`.
    Corrupt,
}

impl std::fmt::Display for Unusable {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Gone => "gone",
            Self::Corrupt => "damaged",
        })
    }
}

/// How an object compares with what an entry recorded of it.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Seen {
    Same,
    /// Its bytes are right, but it was copied or touched.
    Moved(Stat),
    Unusable(Unusable),
}

impl Store {
    /// Looks at an object without reading it, unless it was touched.
    pub(super) fn look_at(&self, digest: Digest, recorded: Stat) -> anyhow::Result<Seen> {
        let path = self.object(digest);
        match Stat::of(&path) {
            Ok(stat) if stat == recorded => Ok(Seen::Same),
            Ok(stat) => Ok(match self.read_object(digest)? {
                Ok(_) => Seen::Moved(stat),
                Err(unusable) => Seen::Unusable(unusable),
            }),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(Seen::Unusable(Unusable::Gone)),
            Err(error) => Err(error).with_context(|| format!("cannot read {}", path.display())),
        }
    }

    /// Reads an object and verifies its bytes; a damaged one is put aside.
    ///
    /// # Errors
    /// What the system says; a missing or damaged object is the inner error.
    pub fn read_object(&self, digest: Digest) -> anyhow::Result<Result<Vec<u8>, Unusable>> {
        let path = self.object(digest);
        match fs::read(&path) {
            Ok(bytes) if Digest::of_bytes(&bytes) == digest => Ok(Ok(bytes)),
            Ok(_) => {
                self.put_aside(&path);
                Ok(Err(Unusable::Corrupt))
            }
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(Err(Unusable::Gone)),
            Err(error) => Err(error).with_context(|| format!("cannot read {}", path.display())),
        }
    }

    /// Moves a damaged file to `bad/`, or removes it where even that fails.
    pub(super) fn put_aside(&self, path: &Path) {
        let name = path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
        let aside = fresh_name(&self.root().join("bad")).with_extension(name);
        if fs::rename(path, aside).is_err() {
            let _ = fs::remove_file(path);
        }
    }

    /// Writes bytes as an object, or keeps the one that is there if it is whole.
    pub(super) fn stage_bytes(&self, bytes: &[u8]) -> anyhow::Result<Staged> {
        let digest = Digest::of_bytes(bytes);
        self.stage(digest, || Temporary::write(&self.temporary(), bytes))
    }

    /// Takes over a finished file as an object; the file goes away if the store has its bytes already.
    pub(super) fn stage_file(&self, path: &Path) -> anyhow::Result<Staged> {
        let bytes = fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
        let adopted = Temporary::adopt(path)?;
        self.stage(Digest::of_bytes(&bytes), move || Ok(adopted))
    }

    fn stage(&self, digest: Digest, write: impl FnOnce() -> anyhow::Result<Temporary>) -> anyhow::Result<Staged> {
        let path = self.object(digest);
        let is_there = path.exists() && self.read_object(digest)?.is_ok();
        let temporary = if is_there { None } else { Some(write()?) };
        Ok(Staged { digest, path, temporary })
    }
}

/// An object on its way into the store.
#[derive(Debug)]
pub(super) struct Staged {
    pub(super) digest: Digest,
    path: PathBuf,
    temporary: Option<Temporary>,
}

impl Staged {
    /// Makes the bytes safe from a power cut.
    pub(super) fn seal(&self) -> anyhow::Result<()> {
        self.temporary.as_ref().map_or(Ok(()), Temporary::seal)
    }

    /// Gives the object its name; returns the folder whose names changed.
    pub(super) fn place(self) -> anyhow::Result<(Stat, PathBuf)> {
        let folder = self.path.parent().expect("objects lie in folders").to_owned();
        if let Some(temporary) = self.temporary {
            make_folder(&folder)?;
            // A second publisher of the same bytes is no news: they are equal by name.
            temporary.place(&self.path)?;
        }
        let stat = Stat::of(&self.path).with_context(|| format!("cannot read {}", self.path.display()))?;
        Ok((stat, folder))
    }
}
