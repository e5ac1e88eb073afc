//! Removes old runs, and the results that no kept run names.
//!
//! [`plan`] decides and changes nothing; [`remove`] does what was decided. A run leaves by one renaming, so a kill
//! half-way leaves each run whole or gone, and the next cleaning removes the results of those that are gone.

mod groups;
mod keep;
mod remove;

use std::{collections::BTreeSet, path::Path};

use serde::Serialize;

use super::holdings::Holdings;
use crate::{
    digest::Digest,
    store::{Entry, Kept, LocalStore},
};

pub use keep::{Limits, Policy, Reason};
pub use remove::remove;

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
