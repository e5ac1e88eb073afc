//! Reads the files of a store to find those that are damaged. Nothing is changed, and a file that cannot be read hides no
//! other.

use std::{
    fs::{self, File},
    io,
    path::{Path, PathBuf},
};

use super::{LocalStore, durable::move_aside, find::EntryOnDisk};
use crate::{
    digest::Digest,
    failpoint::failpoint,
    store::{Entry, Error, entry::EntryFault},
};

/// What is wrong with a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Fault {
    /// Its bytes are not those that were written.
    Damaged,
    /// It is not there.
    Missing,
    /// It cannot be read, for this reason.
    Unreadable(String),
}

/// What lies in the folders of a store, by name.
#[derive(Debug, Default)]
pub struct Inventory {
    /// The keys that have an entry.
    pub keys: Vec<Digest>,
    /// The objects.
    pub objects: Vec<Digest>,
    /// Folders that cannot be listed, and why.
    pub unlisted: Vec<(PathBuf, io::Error)>,
}

impl LocalStore {
    /// Lists what the store holds. Files of other names are not ours.
    pub fn inventory(&self) -> Inventory {
        let mut unlisted = Vec::new();
        let keys = self.digests_below("keys", |key| self.entry_path(key), &mut unlisted);
        let objects = self.digests_below("objects", |object| self.object(object), &mut unlisted);
        Inventory { keys, objects, unlisted }
    }

    /// The digests that the files two levels below a folder are named after; `place` says where the file of a digest lies.
    fn digests_below(
        &self,
        folder: &str,
        place: impl Fn(Digest) -> PathBuf,
        unlisted: &mut Vec<(PathBuf, io::Error)>,
    ) -> Vec<Digest> {
        let mut found = Vec::new();
        for prefix in paths_in(&self.root.join(folder), unlisted).into_iter().filter(|path| path.is_dir()) {
            for path in paths_in(&prefix, unlisted) {
                let names =
                    [prefix.file_name(), path.file_stem()].map(|name| name.unwrap_or_default().to_string_lossy());
                let digest = format!("b3:{}", names.concat()).parse().ok();
                found.extend(digest.filter(|&digest| place(digest) == path));
            }
        }
        found.sort();
        found
    }

    /// Reads an entry.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn verify_entry(&self, key: Digest) -> Result<Entry, Fault> {
        match self.read_entry(key).map_err(unreadable)? {
            EntryOnDisk::Whole(entry) => Ok(*entry),
            EntryOnDisk::Missing => Err(Fault::Missing),
            EntryOnDisk::Unusable(EntryFault::Damaged) => Err(Fault::Damaged),
            EntryOnDisk::Unusable(why) => Err(Fault::Unreadable(why.to_string())),
        }
    }

    /// Reads an object, and returns how many bytes it has.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn verify_object(&self, object: Digest) -> Result<u64, Fault> {
        let open = || {
            let file = failpoint!("read object", File::open(self.object(object)))?;
            Ok((file.metadata()?.len(), Digest::of_reader(file)?))
        };
        match open() {
            Ok((size, found)) if found == object => Ok(size),
            Ok(_) => Err(Fault::Damaged),
            Err(error) if io::Error::kind(&error) == io::ErrorKind::NotFound => Err(Fault::Missing),
            Err(error) => Err(Fault::Unreadable(error.to_string())),
        }
    }

    /// Where the entry of a key lies.
    pub fn path_of_entry(&self, key: Digest) -> PathBuf {
        self.entry_path(key)
    }

    /// Moves a file of the store to `bad/`, where nothing uses it. A file that cannot be moved stays.
    pub fn move_to_bad(&self, path: &Path) {
        let _ = move_aside(path, &self.root.join("bad"));
    }
}

fn unreadable(error: Error) -> Fault {
    match error {
        Error::Io { source, .. } => Fault::Unreadable(source.to_string()),
        other => Fault::Unreadable(other.to_string()),
    }
}

fn paths_in(folder: &Path, unlisted: &mut Vec<(PathBuf, io::Error)>) -> Vec<PathBuf> {
    let paths = fs::read_dir(folder).and_then(|items| items.map(|item| Ok(item?.path())).collect());
    paths.unwrap_or_else(|error: io::Error| {
        if error.kind() == io::ErrorKind::NotFound {
            return Vec::new(); // An empty store has no folders yet.
        }
        unlisted.push((folder.to_owned(), error));
        Vec::new()
    })
}
