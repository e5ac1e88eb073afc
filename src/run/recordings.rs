//! Finds the recordings of a run in the store. A repair may have made recordings to which no file of the run leads.

use std::{
    cell::OnceCell,
    path::{Path, PathBuf},
};

use super::manifest::Manifest;
use crate::store::{LocalStore, ResultStore as _};

/// The recordings of a run that its store has now.
#[derive(Debug)]
pub struct Recordings {
    run_dir: PathBuf,
    /// Read when it is first needed; `None` where it cannot be read.
    manifest: OnceCell<Option<Manifest>>,
}

impl Recordings {
    /// The recordings of the run in a folder below `runs/` of a store.
    pub fn of_run(run_dir: &Path) -> Self {
        Self { run_dir: run_dir.to_owned(), manifest: OnceCell::new() }
    }

    /// The recording of a node's result; `None` where the store lacks the result or its recording. The store is closed
    /// again at once, so an open view does not prevent `gc`.
    pub fn of_node(&self, node: &str) -> Option<PathBuf> {
        let manifest = self.manifest.get_or_init(|| Manifest::read(&self.run_dir).ok()).as_ref()?;
        let outcome = &manifest.node(node)?.outcome;
        let run_dir = self.run_dir.canonicalize().ok()?;
        let store = LocalStore::open_to_read(run_dir.parent()?.parent()?).ok()?;
        let entry = store.entry(outcome.key?).ok()?.filter(|entry| Some(entry.output) == outcome.output)?;
        store.path_of(entry.recording?.object).filter(|path| path.exists())
    }
}
