//! Reads every result of a store, or of a run, and names what is damaged, missing or unreadable.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use rayon::prelude::*;

use super::manifest::{Manifest, Unreadable};
use crate::{
    digest::Digest,
    store::{Entry, Fault, LocalStore, ResultStore as _},
};

/// A file that is not as it was written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Problem {
    /// `manifest`, `entry`, `recording`, `object`, `folder` or the name of an output's file.
    pub what: String,
    /// What is wrong with it.
    pub fault: Fault,
    /// The node that it belongs to, where that is known.
    pub node: Option<String>,
    /// The newest run that uses it, or else the run that made it.
    pub run: Option<String>,
    /// Whether a run uses it.
    pub is_used: bool,
    /// The key of the result that it belongs to, where that is known.
    pub key: Option<Digest>,
    /// Where it lies, or would lie. The entry, for a recording that was never written.
    pub path: PathBuf,
}

/// What was read, and what is wrong with it.
#[derive(Debug, Default)]
pub struct Verified {
    /// The number of runs.
    pub runs: usize,
    /// The number of entries.
    pub entries: usize,
    /// The number of objects.
    pub objects: usize,
    /// The bytes of all objects.
    pub bytes: u64,
    /// What is wrong: manifests first, then entries, then objects.
    pub problems: Vec<Problem>,
}

/// Where a key or an object is used.
#[derive(Debug, Clone, Default)]
struct Use {
    what: String,
    node: Option<String>,
    run: Option<String>,
    is_used: bool,
    key: Option<Digest>,
}

/// Verifies what these runs use, and with `all` everything else in the store, too. `runs` are folders, newest first.
pub fn verify(store: &LocalStore, runs: &[PathBuf], all: bool) -> Verified {
    let mut found = Verified::default();
    let mut keys: BTreeMap<Digest, (Use, Option<Digest>)> = BTreeMap::new();
    for manifest in manifests(runs, &mut found) {
        for record in manifest.nodes.iter().filter(|record| record.outcome.output.is_some()) {
            let Some(key) = record.outcome.key else { continue };
            let used = Use {
                what: "entry".to_owned(),
                node: Some(record.about.name.clone()),
                run: Some(manifest.run.clone()),
                is_used: true,
                key: Some(key),
            };
            keys.entry(key).or_insert((used, record.outcome.output));
        }
    }
    let mut objects: BTreeMap<Digest, Use> = BTreeMap::new();
    if all {
        let inventory = store.inventory();
        for key in inventory.keys {
            let unused = Use { what: "entry".to_owned(), key: Some(key), ..Use::default() };
            keys.entry(key).or_insert((unused, None));
        }
        objects.extend(inventory.objects.into_iter().map(|object| (object, Use::of("object"))));
        for (path, why) in inventory.unlisted {
            found.problems.push(Use::of("folder").problem(Fault::Unreadable(why.to_string()), path));
        }
    }
    // What runs use comes first, so that an object that others use too is named after the run.
    let (used, unused): (Vec<_>, Vec<_>) = keys.into_iter().partition(|(_, (used, _))| used.is_used);
    for (key, (used, output)) in used.into_iter().chain(unused) {
        match store.verify_entry(key) {
            Ok(entry) => found.take_entry(store, entry, used, output, &mut objects),
            Err(fault) => found.problems.push(used.problem(fault, store.path_of_entry(key))),
        }
    }
    found.read_objects(store, objects);
    found
}

/// The manifests that can be read. A run that was killed before its first node started has none, and names nothing.
fn manifests(runs: &[PathBuf], found: &mut Verified) -> Vec<Manifest> {
    let mut manifests = Vec::new();
    for run_dir in runs {
        let path = run_dir.join("manifest.json");
        if !path.exists() {
            continue;
        }
        found.runs += 1;
        match Manifest::read(run_dir) {
            Ok(manifest) => manifests.push(manifest),
            Err(error) => {
                let run = run_dir.file_name().map(|name| name.to_string_lossy().into_owned());
                let fault = match error {
                    Unreadable::Damaged { .. } => Fault::Damaged,
                    other => Fault::Unreadable(format!("{:#}", anyhow::Error::from(other))),
                };
                found.problems.push(Use { run, is_used: true, ..Use::of("manifest") }.problem(fault, path));
            }
        }
    }
    manifests
}

impl Use {
    fn of(what: &str) -> Self {
        Self { what: what.to_owned(), ..Self::default() }
    }

    fn problem(self, fault: Fault, path: PathBuf) -> Problem {
        let Self { what, node, run, is_used, key } = self;
        Problem { what, fault, node, run, is_used, key, path }
    }
}

impl Verified {
    /// Counts an entry and notes the objects that it names.
    fn take_entry(
        &mut self,
        store: &LocalStore,
        entry: Entry,
        used: Use,
        output: Option<Digest>,
        objects: &mut BTreeMap<Digest, Use>,
    ) {
        self.entries += 1;
        let node = used.node.unwrap_or(entry.node);
        let run = used.run.unwrap_or(entry.run);
        let (is_used, key) = (used.is_used, used.key);
        let named =
            |what: &str| Use { node: Some(node.clone()), run: Some(run.clone()), is_used, key, ..Use::of(what) };
        let entry_path = || store.path_of_entry(entry.key_digest);
        if output.is_some_and(|output| output != entry.output) {
            self.problems.push(named("output").problem(Fault::Missing, entry_path()));
        }
        let mut note = |what: &str, object| {
            let kept = objects.entry(object).or_default();
            if kept.key.is_none() {
                *kept = named(what);
            }
        };
        entry.files.iter().for_each(|file| note(&file.name, file.object));
        match &entry.recording {
            Some(recording) => note("recording", recording.object),
            None if !is_used => {} // Nobody misses it.
            None => self.problems.push(named("recording").problem(Fault::Missing, entry_path())),
        }
    }

    /// Reads all objects, on every core.
    fn read_objects(&mut self, store: &LocalStore, objects: BTreeMap<Digest, Use>) {
        let objects: Vec<(Digest, Use)> = objects.into_iter().collect();
        let read: Vec<_> = objects.par_iter().map(|(object, _)| store.verify_object(*object)).collect();
        self.objects = objects.len();
        for ((object, used), result) in objects.into_iter().zip(read) {
            match result {
                Ok(bytes) => self.bytes += bytes,
                Err(fault) => self.problems.push(used.problem(fault, store.path_of(object).unwrap_or_default())),
            }
        }
    }
}

/// The folders of all runs, newest first.
///
/// # Errors
/// The folder cannot be read.
pub fn run_folders(runs: &Path) -> anyhow::Result<Vec<PathBuf>> {
    Ok(super::runs::list(runs)?.into_iter().map(|run| runs.join(run.id)).collect())
}
