//! What the program asks of a store.

use std::{fmt::Debug, path::PathBuf};

use super::{Entry, FileRef, Files, Holder, NewEntry, Result, files::Content};
use crate::digest::Digest;

/// Files up to this size are loaded into memory; larger ones are handed on as verified files.
const LOADED_INTO_MEMORY: u64 = 16 << 20;

/// A place that keeps results: entries by the key that made them, and the objects that entries name.
///
/// Every implementation promises:
/// - An entry appears only after all objects that it names, and both survive a power cut from then on.
/// - An object or an entry appears whole or not at all, and is never changed.
/// - The first result that is published for a key counts for as long as it is whole.
/// - Bytes are verified against their digest before they are handed on. A damaged object is set aside, never served.
pub trait ResultStore: Debug + Sync {
    /// Looks a key up. An object is read only where its file has been touched since it was published.
    ///
    /// # Errors
    /// The system refused an operation.
    fn find(&self, key: Digest) -> Result<Lookup>;

    /// The entry of a key, whether or not its objects are still there.
    ///
    /// # Errors
    /// The system refused an operation.
    fn entry(&self, key: Digest) -> Result<Option<Entry>>;

    /// The verified bytes of a file.
    ///
    /// # Errors
    /// [`super::Error::Unusable`] for a missing or damaged object, or the system refused an operation.
    fn read(&self, file: &FileRef) -> Result<Vec<u8>>;

    /// The path of a file on this machine, once its bytes are verified. The file must only be read.
    ///
    /// # Errors
    /// [`super::Error::Unusable`] for a missing or damaged object, or the system refused an operation.
    fn open(&self, file: &FileRef) -> Result<PathBuf>;

    /// Publishes a result: first every object, then the entry that names them.
    ///
    /// # Errors
    /// The system refused an operation; then nothing is published.
    fn publish(&self, new: NewEntry<'_>) -> Result<Published>;

    /// The lock of a key, or `None` while another process holds it. Dropping the lock frees it, and so does the death
    /// of its process.
    ///
    /// # Errors
    /// The system refused an operation.
    fn try_lock(&self, key: Digest) -> Result<Option<Box<dyn KeyLock>>>;

    /// The process that holds the lock of a key, where the system tells.
    fn holder(&self, key: Digest) -> Option<Holder>;

    /// A path on this machine for a file that is to be published, or for a folder of temporary files; the store can take
    /// files over from there cheaply. What a killed process leaves there is removed later. `name` must be this caller's
    /// alone.
    fn scratch_path(&self, name: &str) -> PathBuf;

    /// Where an object lies on this machine, for people to look at; `None` where it lies elsewhere.
    fn path_of(&self, object: Digest) -> Option<PathBuf>;

    /// Verifies every file of a result and loads it: small files into memory, large ones as paths.
    ///
    /// # Errors
    /// [`super::Error::Unusable`] for a missing or damaged object, or the system refused an operation.
    fn load(&self, entry: &Entry) -> Result<Files> {
        let load = |file: &FileRef| {
            let content = if file.stat.size > LOADED_INTO_MEMORY {
                Content::File(self.open(file)?)
            } else {
                Content::Bytes(self.read(file)?)
            };
            Ok((file.name.clone(), content))
        };
        entry.files.iter().map(load).collect()
    }
}

/// The right to make the result of one key; dropping the value gives the right back.
pub trait KeyLock: Debug + Send + Sync {}

/// What a store has for a key.
#[derive(Debug)]
pub enum Lookup {
    /// A result whose objects are there and untouched.
    Hit(Box<Entry>),
    /// Nothing.
    Miss,
    /// A result that cannot be used, and why.
    Unusable(String),
}

/// What publishing did.
#[derive(Debug)]
pub struct Published {
    /// The entry that now counts for the key.
    pub entry: Entry,
    /// The digest of a second, different output of the same key. It shows that the kind is not deterministic.
    pub differs: Option<Digest>,
}
