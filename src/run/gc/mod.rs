//! Removes old runs, and the results that no kept run names.
//!
//! [`plan`] decides and changes nothing; [`remove`] does what was decided. A run leaves by one renaming, so a kill
//! half-way leaves each run whole or gone, and the next cleaning removes the results of those that are gone.

mod groups;
mod keep;

use std::{
    collections::BTreeSet,
    fs::{self, File},
    io,
    path::Path,
};

use anyhow::Context as _;
use serde::Serialize;

use super::{holdings::Holdings, runs, strays};
use crate::{
    digest::Digest,
    store::{Entry, Kept, LocalStore},
};

pub use keep::{Limits, Policy, Reason};

/// The name of the folder of a run that is being removed begins so.
const GONE: &str = ".gone-";

/// What a cleaning removes and keeps.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Plan {
    /// The runs that go, newest first.
    pub removed: Vec<RemovedRun>,
    /// The runs that stay, newest first.
    pub kept: Vec<KeptRun>,
    /// Results that go.
    pub entries: usize,
    /// Objects that go.
    pub objects: usize,
    /// Bytes that become free.
    pub bytes: u64,
    /// Bytes of the results and folders that stay.
    pub kept_bytes: u64,
    /// The results that stay.
    #[serde(skip)]
    kept_entries: Vec<Entry>,
}

/// A run that goes.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct RemovedRun {
    /// Its id.
    pub run: String,
    /// Its pipeline.
    pub pipeline: Option<String>,
    /// The results that go with it. A result that several of the runs name counts for the newest of them.
    pub entries: usize,
    /// Bytes of these results and of its folder.
    pub bytes: u64,
}

/// A run that stays.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct KeptRun {
    /// Its id.
    pub run: String,
    /// Its pipeline.
    pub pipeline: Option<String>,
    /// Why it stays.
    pub reason: Reason,
    /// What is wrong with its manifest.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub problem: Option<&'static str>,
    /// How many results it may name.
    pub entries: usize,
    /// Whether all results stay, because nothing tells which ones this run names.
    pub keeps_all: bool,
}

impl Plan {
    /// Whether there is nothing to remove.
    pub fn is_empty(&self) -> bool {
        self.removed.is_empty() && self.entries == 0 && self.objects == 0 && self.bytes == 0
    }
}

/// Decides what goes. Reads everything and changes nothing.
///
/// # Errors
/// The store or the folder of the runs cannot be read.
pub fn plan(store: &LocalStore, runs: &Path, policy: &Policy) -> anyhow::Result<Plan> {
    let holdings = Holdings::read(store, runs)?;
    let reasons = keep::reasons(&holdings, policy);
    let mut kept_results = keep::results(&holdings, &reasons);
    let may_name_anything = |at: usize| reasons[at].is_some() && holdings.runs[at].may_name_anything;
    if (0..reasons.len()).any(may_name_anything) {
        kept_results = holdings.entries.keys().copied().collect();
    }
    let kept_entries: Vec<Entry> = kept_results.iter().filter_map(|key| holdings.entries.get(key)).cloned().collect();
    let counted = store.clean(&kept(&kept_entries), true)?;
    let kept_objects: BTreeSet<Digest> = holdings.objects_of(&kept_results).collect();
    let mut plan = Plan {
        removed: removed(&holdings, &reasons, &kept_results, &kept_objects),
        kept: Vec::new(),
        entries: counted.entries,
        objects: counted.objects,
        bytes: counted.bytes,
        kept_bytes: kept_objects.iter().map(|&object| holdings.bytes(object)).sum(),
        kept_entries,
    };
    for (run, reason) in holdings.runs.iter().zip(&reasons) {
        match *reason {
            None => plan.bytes += run.folder_bytes,
            Some(reason) => {
                plan.kept_bytes += run.folder_bytes;
                plan.kept.push(KeptRun {
                    run: run.id.clone(),
                    pipeline: run.pipeline.clone(),
                    reason,
                    problem: run.problem,
                    entries: run.results.len(),
                    keeps_all: run.may_name_anything,
                });
            }
        }
    }
    Ok(plan)
}

/// The runs that go, each with what only it and older runs name.
fn removed(
    holdings: &Holdings,
    reasons: &[Option<Reason>],
    kept_results: &BTreeSet<Digest>,
    kept_objects: &BTreeSet<Digest>,
) -> Vec<RemovedRun> {
    let (mut results, mut objects) = (kept_results.clone(), kept_objects.clone());
    let mut removed = Vec::new();
    for (run, _) in holdings.runs.iter().zip(reasons).filter(|(_, reason)| reason.is_none()) {
        let own: BTreeSet<Digest> = run.results.iter().copied().filter(|&key| results.insert(key)).collect();
        let fresh = holdings.objects_of(&own).filter(|&object| objects.insert(object));
        let bytes: u64 = fresh.map(|object| holdings.bytes(object)).sum();
        removed.push(RemovedRun {
            run: run.id.clone(),
            pipeline: run.pipeline.clone(),
            entries: own.len(),
            bytes: bytes + run.folder_bytes,
        });
    }
    removed
}

fn kept(entries: &[Entry]) -> Kept {
    let mut kept = Kept::default();
    entries.iter().for_each(|entry| kept.add(entry));
    kept
}

/// Removes what a plan says. The store must be open alone, and the plan made since: no run may be in progress.
///
/// # Errors
/// The system refused an operation. The next cleaning removes what is left.
pub fn remove(store: &LocalStore, runs: &Path, plan: &Plan) -> anyhow::Result<()> {
    for RemovedRun { run, .. } in &plan.removed {
        let path = runs.join(run);
        let gone = runs.join(format!("{GONE}{run}"));
        fs::rename(&path, &gone).with_context(|| format!("cannot remove {}", path.display()))?;
    }
    if !plan.removed.is_empty() {
        point_latest(runs)?;
        // Before a result goes, so that no power cut brings back a run without its results.
        File::open(runs)
            .and_then(|folder| folder.sync_all())
            .with_context(|| format!("cannot write {}", runs.display()))?;
    }
    store.clean(&kept(&plan.kept_entries), false)?;
    strays::sweep_links(runs);
    plan.kept.iter().for_each(|kept| strays::sweep_run(&runs.join(&kept.run)));
    sweep(runs)
}

/// Removes the folders that this or an earlier cleaning has renamed.
fn sweep(runs: &Path) -> anyhow::Result<()> {
    let items = match fs::read_dir(runs) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
        items => items.with_context(|| format!("cannot read {}", runs.display()))?,
    };
    for path in items.flatten().map(|item| item.path()) {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if name.strip_prefix(GONE).is_some_and(runs::is_id) {
            fs::remove_dir_all(&path).with_context(|| format!("cannot remove {}", path.display()))?;
        }
    }
    Ok(())
}

/// Lets `latest` point to the newest run that is left, where it points to none.
fn point_latest(runs: &Path) -> anyhow::Result<()> {
    let latest = runs.join("latest");
    if latest.exists() || fs::symlink_metadata(&latest).is_err() {
        return Ok(());
    }
    let repoint = |newest: Option<&runs::Found>| {
        fs::remove_file(&latest)?;
        newest.map_or(Ok(()), |newest| std::os::unix::fs::symlink(&newest.id, &latest))
    };
    repoint(runs::list(runs)?.first()).with_context(|| format!("cannot write {}", latest.display()))
}
