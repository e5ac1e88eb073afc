//! The contract of a store, kept by the store in a folder.

use std::{collections::BTreeMap, fs, os::unix::fs::PermissionsExt as _, path::PathBuf};

use crate::support::run::damage;
use carl_pipe::store::{
    Content, Error, Files, Key, LocalStore, Lookup, NewEntry, Problem, Published, ResultStore as _,
};
use serde_json::json;

struct Folder {
    folder: tempfile::TempDir,
    store: LocalStore,
}

impl Folder {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let store = LocalStore::open(&folder.path().join("store")).unwrap();
        Self { folder, store }
    }

    fn file(&self, bytes: &[u8]) -> PathBuf {
        let path = self.folder.path().join("made");
        fs::write(&path, bytes).unwrap();
        path
    }

    fn publish(&self, key: &Key, files: &Files) -> Published {
        let (metrics, recording) = (BTreeMap::new(), None);
        let new = NewEntry { key, node: "a", run: "r", files, recording, metrics, secs: 1.0, recorder_secs: 0.0 };
        self.store.publish(new).unwrap()
    }
}

fn key(number: u64) -> Key {
    Key::of_json(json!({ "number": number }))
}

#[test]
fn a_file_and_the_same_bytes_in_memory_are_one_object() {
    let folder = Folder::new();
    let path = folder.file(b"model");
    let taken = folder.publish(&key(1), &Files::from([("model", Content::File(path.clone()))]));
    let copied = folder.publish(&key(2), &Files::from([("model", b"model".to_vec())]));
    assert_eq!(taken.entry.output, copied.entry.output);
    assert!(!path.exists(), "the store takes the file over");
    let files = folder.store.load(&taken.entry).unwrap();
    assert_eq!(&*files.bytes("model").unwrap(), b"model");
}

#[test]
fn a_file_of_another_file_system_is_taken_over() {
    let folder = Folder::new();
    let Ok(elsewhere) = tempfile::tempdir_in("/dev/shm") else { return };
    let path = elsewhere.path().join("made");
    fs::write(&path, b"model").unwrap();
    let published = folder.publish(&key(1), &Files::from([("model", Content::File(path.clone()))]));
    let opened = folder.store.open(&published.entry.files[0]).unwrap();
    assert_eq!((fs::read(&opened).unwrap(), path.exists()), (b"model".to_vec(), false));
}

#[test]
fn an_object_is_read_only_and_opens_as_a_verified_path() {
    let folder = Folder::new();
    let published = folder.publish(&key(1), &Files::from([("model", b"model".to_vec())]));
    let file = &published.entry.files[0];
    let path = folder.store.open(file).unwrap();
    assert_eq!(fs::metadata(&path).unwrap().permissions().mode() & 0o777, 0o444);
    damage(&path);
    let error = folder.store.open(file).unwrap_err();
    assert!(matches!(error, Error::Unusable { problem: Problem::Damaged, .. }), "{error}");
    assert_eq!(error.to_string(), "its model is damaged");
    let error = folder.store.read(file).unwrap_err();
    assert!(matches!(error, Error::Unusable { problem: Problem::Gone, .. }), "{error}");
}

#[test]
fn the_first_output_of_a_key_counts_while_it_is_whole() {
    let folder = Folder::new();
    let first = folder.publish(&key(1), &Files::from([("model", b"one".to_vec())])).entry;
    let second = folder.publish(&key(1), &Files::from([("model", b"two".to_vec())]));
    assert_eq!((second.entry.output, second.differs.is_some()), (first.output, true));
    damage(&folder.store.path_of(first.files[0].object).unwrap());
    let third = folder.publish(&key(1), &Files::from([("model", b"two".to_vec())]));
    assert_eq!(Some(third.entry.output), second.differs);
}

#[test]
fn a_key_is_locked_by_one_holder_at_a_time() {
    let folder = Folder::new();
    let lock = folder.store.try_lock(key(1).digest).unwrap();
    assert!(lock.is_some() && folder.store.try_lock(key(1).digest).unwrap().is_none());
    drop(lock);
    assert!(folder.store.try_lock(key(1).digest).unwrap().is_some());
}

#[test]
fn a_key_that_nobody_made_is_a_miss() {
    assert!(matches!(Folder::new().store.find(key(1).digest).unwrap(), Lookup::Miss));
}
