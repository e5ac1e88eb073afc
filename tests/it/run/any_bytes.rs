//! Any file read as an entry, a manifest or the marks of a run is refused by name, or is what was written.

use std::{fs, path::Path};

use crate::support::mutated::{Mutation, any_bytes, corpus, modestly, mutation, whole};
use carl_pipe::{
    digest::Digest,
    run::{manifest::Manifest, marks::Marks},
    store::{Fault, LocalStore, Lookup, ResultStore as _},
};
use proptest::prelude::*;
use serde_json::Value;

thread_local! {
    /// One store for all cases of a test: to make one takes long.
    static STORE: (tempfile::TempDir, LocalStore) = {
        let folder = tempfile::tempdir().unwrap();
        let store = LocalStore::open(folder.path()).unwrap();
        (folder, store)
    };
}

/// Reads an entry of the corpus as that of a key; returns it as text.
fn entry(key: Digest, bytes: &[u8]) -> Result<String, Fault> {
    STORE.with(|(_, store)| entry_in(store, key, bytes))
}

fn entry_in(store: &LocalStore, key: Digest, bytes: &[u8]) -> Result<String, Fault> {
    let path = store.path_of_entry(key);
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    _ = fs::remove_file(&path);
    fs::write(&path, bytes).unwrap();
    let entry = modestly(bytes, |_| store.verify_entry(key));
    assert_eq!(store.entry(key).unwrap(), entry.as_ref().ok().cloned());
    // A look-up never takes what cannot be read.
    assert!(matches!(store.find(key).unwrap(), Lookup::Unusable(_)), "its objects are gone");
    entry.map(|entry| format!("{entry:?}"))
}

/// The key that an entry names.
fn key(bytes: &[u8]) -> Digest {
    let text: Value = serde_json::from_slice(bytes).unwrap();
    text["entry"]["key_digest"].as_str().unwrap().parse().unwrap()
}

/// Reads a file of the folder of a run.
fn in_run<T: std::fmt::Debug>(name: &str, bytes: &[u8], read: fn(&Path) -> anyhow::Result<T>) -> Option<String> {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join(name), bytes).unwrap();
    match modestly(bytes, |_| read(folder.path())) {
        Ok(value) => Some(format!("{value:?}")),
        Err(error) => {
            assert!(format!("{error:#}").contains(name), "{error:#}");
            None
        }
    }
}

fn manifest(bytes: &[u8]) -> Option<String> {
    // Every reading here has a folder of its own.
    in_run("manifest.json", bytes, |run_dir| Ok(Manifest { run_dir: None, ..Manifest::read(run_dir)? }))
}

fn marks(bytes: &[u8]) -> Option<String> {
    in_run("marks.json", bytes, Marks::read)
}

#[test]
fn the_corpus_is_read_or_refused() {
    for (path, bytes, is_whole) in corpus("manifests") {
        assert_eq!(manifest(&bytes).is_some(), is_whole, "{}", path.display());
    }
    for (path, bytes, is_whole) in corpus("marks") {
        assert_eq!(marks(&bytes).is_some(), is_whole, "{}", path.display());
    }
    let some_key = key(&whole("entries")[0]);
    for (path, bytes, is_whole) in corpus("entries") {
        assert_eq!(entry(some_key, &bytes).is_ok(), is_whole, "{}", path.display());
    }
}

/// What was written last counts: a changed file that is read says what the whole one says.
fn is_refused_or_same(mutation: &Mutation, kind: &str, read: impl Fn(&[u8]) -> Option<String>) {
    let (whole, changed) = mutation.of_corpus(kind);
    let now = read(&changed);
    assert!(now.is_none() || now == read(&whole), "{:?}", String::from_utf8_lossy(&changed));
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn arbitrary_bytes(bytes in any_bytes()) {
        prop_assert_eq!(manifest(&bytes), None);
        prop_assert_eq!(marks(&bytes), None);
        prop_assert!(entry(key(&whole("entries")[0]), &bytes).is_err());
    }

    #[test]
    fn an_entry_with_any_change(mutation in mutation()) {
        let key = key(&whole("entries")[0]);
        is_refused_or_same(&mutation, "entries", |bytes| entry(key, bytes).ok());
    }

    #[test]
    fn a_manifest_with_any_change(mutation in mutation()) {
        is_refused_or_same(&mutation, "manifests", manifest);
    }

    #[test]
    fn marks_with_any_change(mutation in mutation()) {
        is_refused_or_same(&mutation, "marks", marks);
    }
}
