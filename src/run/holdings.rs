//! Which run names which results of a store, and how much room they take.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::Path,
};

use serde::Serialize;

use super::{
    events::RunState,
    manifest::{Manifest, Unreadable},
    marks::Marks,
    runs::{self, Found},
    salvage::Salvaged,
    utc,
};
use crate::{
    digest::Digest,
    store::{Entry, LocalStore, ResultStore as _},
};

/// The runs of a store, and what each of them names.
#[derive(Debug)]
pub struct Holdings {
    /// Newest first.
    pub runs: Vec<Holding>,
    /// Every whole entry of the store by its key.
    pub entries: BTreeMap<Digest, Entry>,
    /// Bytes of every object that an entry names.
    pub objects: BTreeMap<Digest, u64>,
}

/// A run, and what it names.
#[derive(Debug, Clone)]
pub struct Holding {
    /// Its id.
    pub id: String,
    /// The name of its pipeline; `None` where nothing tells it.
    pub pipeline: Option<String>,
    /// How it stands.
    pub state: Standing,
    /// What is wrong with its manifest; `None` where nothing is.
    pub problem: Option<&'static str>,
    /// When it started, in seconds since 1970.
    pub started_secs: Option<u64>,
    /// Whether a pin or a tag keeps it, or marks that cannot be read.
    pub is_pinned: bool,
    /// Whether `latest` means it.
    pub is_latest: bool,
    /// The keys of the results that it names and that the store has.
    pub results: BTreeSet<Digest>,
    /// Whether nothing tells what it names, so that it may name anything.
    pub may_name_anything: bool,
    /// Bytes in its folder.
    pub folder_bytes: u64,
}

/// How a run stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Standing {
    /// Its process lives.
    Running,
    /// Every wanted node has its output.
    Finished,
    /// A node failed.
    Failed,
    /// The user stopped it.
    Interrupted,
    /// Its process died before the run ended.
    Killed,
    /// Its manifest cannot be read.
    Unreadable,
}

impl Standing {
    /// How a run stands whose manifest, if it has a readable one, says `state`.
    pub fn of(run_dir: &Path, state: Option<RunState>) -> Self {
        match state {
            _ if runs::is_alive(run_dir) => Self::Running,
            Some(RunState::Running) => Self::Killed,
            Some(RunState::Finished) => Self::Finished,
            Some(RunState::Failed) => Self::Failed,
            Some(RunState::Interrupted) => Self::Interrupted,
            None => Self::Unreadable,
        }
    }

    /// The word for it.
    pub fn word(self) -> &'static str {
        match self {
            Self::Running => "running",
            Self::Finished => "finished",
            Self::Failed => "failed",
            Self::Interrupted => "interrupted",
            Self::Killed => "killed",
            Self::Unreadable => "unreadable",
        }
    }
}

impl Holdings {
    /// Reads every run below `runs` and every entry of the store.
    ///
    /// # Errors
    /// The folder of the runs or the store cannot be read.
    pub fn read(store: &LocalStore, runs: &Path) -> anyhow::Result<Self> {
        let entries: BTreeMap<Digest, Entry> =
            store.entries()?.into_iter().map(|entry| (entry.key_digest, entry)).collect();
        let size = |object| store.path_of(object).and_then(|path| fs::metadata(path).ok()).map_or(0, |meta| meta.len());
        let objects: BTreeSet<Digest> = entries.values().flat_map(Entry::objects).collect();
        let objects = objects.into_iter().map(|object| (object, size(object))).collect();
        let pointed = fs::read_link(runs.join("latest")).ok();
        let mut holdings = Self { runs: Vec::new(), entries, objects };
        let latest: Vec<_> = runs::find(runs, "latest").ok().into_iter().chain(pointed).collect();
        for (found, manifest) in runs::manifests(runs)? {
            let is_latest = latest.iter().any(|path| path.ends_with(&found.id));
            let holding = holding(&found, manifest, &runs.join(&found.id), &holdings.entries, is_latest);
            holdings.runs.push(holding);
        }
        Ok(holdings)
    }

    /// The objects of these results.
    pub fn objects_of<'a>(&'a self, keys: &'a BTreeSet<Digest>) -> impl Iterator<Item = Digest> + 'a {
        keys.iter().filter_map(|key| self.entries.get(key)).flat_map(Entry::objects)
    }

    /// The bytes of an object.
    pub fn bytes(&self, object: Digest) -> u64 {
        self.objects.get(&object).copied().unwrap_or(0)
    }
}

fn holding(
    found: &Found,
    manifest: Result<Manifest, Unreadable>,
    run_dir: &Path,
    entries: &BTreeMap<Digest, Entry>,
    is_latest: bool,
) -> Holding {
    let manifest_is_there = !matches!(manifest, Err(Unreadable::Missing(_)));
    let problem = manifest.as_ref().err().map(Unreadable::short);
    let manifest = manifest.ok();
    let keys = manifest.iter().flat_map(|manifest| &manifest.nodes).filter_map(|record| record.outcome.key);
    let mut results: BTreeSet<Digest> = keys.filter(|key| entries.contains_key(key)).collect();
    // Only the manifest of a finished run, and only one that is sealed, is known to name everything.
    let names_all =
        manifest.as_ref().is_some_and(|manifest| manifest.state == RunState::Finished && manifest.is_sealed());
    let mut may_name_anything = false;
    if !names_all {
        let salvaged = Salvaged::of(run_dir);
        let ids = [Some(found.id.as_str()), manifest.as_ref().map(|manifest| manifest.run.as_str())];
        let is_its = |entry: &&Entry| salvaged.names(entry) || ids.contains(&Some(entry.run.as_str()));
        results.extend(entries.values().filter(is_its).map(|entry| entry.key_digest));
        may_name_anything = manifest.is_none() && manifest_is_there && salvaged.is_empty() && results.is_empty();
    }
    // Until a node starts to work there is no manifest, and nothing that a run could have made.
    let has_begun = manifest_is_there || !results.is_empty();
    let state = match Standing::of(run_dir, manifest.as_ref().map(|manifest| manifest.state)) {
        Standing::Unreadable if !has_begun => Standing::Killed,
        state => state,
    };
    Holding {
        id: found.id.clone(),
        pipeline: manifest.as_ref().map(|it| it.pipeline.clone()).or_else(|| runs::pipeline_of(run_dir)),
        state,
        problem: problem.filter(|_| state == Standing::Unreadable),
        started_secs: manifest.as_ref().and_then(|manifest| utc::secs(&manifest.started)),
        is_pinned: Marks::read(run_dir).map_or(true, |marks| marks.keep()),
        is_latest,
        results,
        may_name_anything,
        folder_bytes: bytes_below(run_dir),
    }
}

/// The bytes of the files below a folder. Links are not followed.
pub fn bytes_below(folder: &Path) -> u64 {
    let items = fs::read_dir(folder).into_iter().flatten().flatten();
    let bytes = |item: fs::DirEntry| match item.metadata() {
        Ok(meta) if meta.is_dir() => bytes_below(&item.path()),
        Ok(meta) if meta.is_file() => meta.len(),
        _ => 0,
    };
    items.map(bytes).sum()
}
