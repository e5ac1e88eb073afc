//! Objects: files named by the digest of their bytes. They are written once, verified when used, and set aside when
//! damaged.

use std::{
    fs::{self, File},
    io,
    os::unix::fs::MetadataExt as _,
    path::{Path, PathBuf},
};

use super::{
    LocalStore,
    durable::{Temporary, make_folder, move_aside},
};
use crate::{
    digest::Digest,
    failpoint::failpoint,
    store::{Content, Problem, Result, Stat, error::OrIo as _},
};

impl Stat {
    fn of(path: &Path) -> io::Result<Self> {
        let meta = failpoint!("look at object", fs::symlink_metadata(path))?;
        let ns = |secs: i64, nanos: i64| secs.saturating_mul(1_000_000_000).saturating_add(nanos);
        Ok(Self {
            size: meta.len(),
            mtime_ns: ns(meta.mtime(), meta.mtime_nsec()),
            ctime_ns: ns(meta.ctime(), meta.ctime_nsec()),
            inode: meta.ino(),
        })
    }
}

/// How an object compares with what an entry says about it.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum ObjectState {
    /// Nobody has touched the file.
    Same,
    /// The bytes are right, but the file was copied or touched.
    Moved(Stat),
    /// The object cannot be used.
    Unusable(Problem),
}

impl LocalStore {
    /// Compares an object with what an entry says about it. The object is read only if its file was touched.
    pub(super) fn look_at(&self, digest: Digest, recorded: Stat) -> Result<ObjectState> {
        let path = self.object(digest);
        match Stat::of(&path) {
            Ok(stat) if stat == recorded => Ok(ObjectState::Same),
            Ok(stat) => Ok(match self.verify(digest)? {
                None => ObjectState::Moved(stat),
                Some(problem) => ObjectState::Unusable(problem),
            }),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(ObjectState::Unusable(Problem::Gone)),
            Err(error) => Err(error).or_io(|| cannot_read(&path)),
        }
    }

    /// Reads an object and verifies its bytes. A damaged object is set aside.
    pub(super) fn read_object(&self, digest: Digest) -> Result<std::result::Result<Vec<u8>, Problem>> {
        let path = self.object(digest);
        match failpoint!("read object", fs::read(&path)) {
            Ok(bytes) if Digest::of_bytes(&bytes) == digest => Ok(Ok(bytes)),
            Ok(_) => {
                self.set_aside(&path);
                Ok(Err(Problem::Damaged))
            }
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(Err(Problem::Gone)),
            Err(error) => Err(error).or_io(|| cannot_read(&path)),
        }
    }

    /// Verifies an object without holding it in memory. A damaged object is set aside.
    pub(super) fn verify(&self, digest: Digest) -> Result<Option<Problem>> {
        let path = self.object(digest);
        match failpoint!("read object", File::open(&path).and_then(Digest::of_reader)) {
            Ok(found) if found == digest => Ok(None),
            Ok(_) => {
                self.set_aside(&path);
                Ok(Some(Problem::Damaged))
            }
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(Some(Problem::Gone)),
            Err(error) => Err(error).or_io(|| cannot_read(&path)),
        }
    }

    /// Moves a damaged file to `bad/`, or removes it where it cannot be moved. A reader leaves it where it is.
    pub(super) fn set_aside(&self, path: &Path) {
        if self.may_write && move_aside(path, &self.root.join("bad")).is_err() {
            let _ = fs::remove_file(path);
        }
    }

    /// Prepares content to become an object.
    pub(super) fn stage(&self, content: &Content) -> Result<Staged> {
        match content {
            Content::Bytes(bytes) => self.stage_parts(std::slice::from_ref(bytes)),
            Content::Parts(parts) => self.stage_parts(parts),
            Content::File(path) => self.stage_file(path),
        }
    }

    /// Prepares bytes in parts to become an object.
    fn stage_parts(&self, parts: &[Vec<u8>]) -> Result<Staged> {
        self.stage_as(Digest::of_parts(parts), || Temporary::write(&self.scratch, parts))
    }

    /// Prepares a finished file to become an object. The file goes away if the store has its bytes already.
    pub(super) fn stage_file(&self, path: &Path) -> Result<Staged> {
        let file = Temporary::take_over(path, &self.scratch)?;
        let digest = file.digest()?;
        self.stage_as(digest, move || Ok(file))
    }

    fn stage_as(&self, digest: Digest, write: impl FnOnce() -> Result<Temporary>) -> Result<Staged> {
        let path = self.object(digest);
        let is_there = path.exists() && self.verify(digest)?.is_none();
        let temporary = if is_there { None } else { Some(write()?) };
        Ok(Staged { digest, path, temporary })
    }
}

fn cannot_read(path: &Path) -> String {
    format!("cannot read {}", path.display())
}

/// An object that is not in its place yet, or that the store has already.
#[derive(Debug)]
pub(super) struct Staged {
    digest: Digest,
    path: PathBuf,
    temporary: Option<Temporary>,
}

/// An object in its place.
#[derive(Debug)]
pub(super) struct Placed {
    pub(super) digest: Digest,
    pub(super) stat: Stat,
    /// The folder that has a new name in it.
    pub(super) folder: PathBuf,
}

impl Staged {
    /// Makes the bytes safe from a power cut.
    pub(super) fn seal(&self) -> Result<()> {
        self.temporary.as_ref().map_or(Ok(()), Temporary::seal)
    }

    /// Gives the object its name.
    pub(super) fn place(self) -> Result<Placed> {
        let folder = self.path.parent().expect("an object lies in a folder").to_owned();
        if let Some(temporary) = self.temporary {
            make_folder(&folder)?;
            // If another process has placed the same object, its bytes are equal.
            temporary.place(&self.path)?;
        }
        let stat = Stat::of(&self.path).or_io(|| cannot_read(&self.path))?;
        Ok(Placed { digest: self.digest, stat, folder })
    }
}
