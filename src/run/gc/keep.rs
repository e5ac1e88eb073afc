//! Decides which runs stay.

use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;

use super::groups::groups;
use crate::{
    digest::Digest,
    run::{
        holdings::{Holding, Holdings, Standing},
        utc,
    },
};

/// What a cleaning is asked for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Policy {
    /// Remove what the limits do not keep.
    Limits(Limits),
    /// Remove these runs, by their ids, and nothing else that a run names.
    Drop(BTreeSet<String>),
}

/// What is kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// How many runs of each pipeline. Runs count as one if one of them has the results of all.
    pub keep: usize,
    /// Keep every run that is not older than this, in seconds.
    pub older_than_secs: Option<u64>,
    /// Then remove further runs, oldest first, until results and runs take no more bytes than this.
    pub max_bytes: Option<u64>,
}

/// Why a run stays.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Reason {
    /// Its process lives.
    Running,
    /// The user has pinned or tagged it.
    Pinned,
    /// Its manifest cannot be read, so it is not known what it is worth.
    Unreadable,
    /// `latest` means it.
    Latest,
    /// It is the newest run of its pipeline, or the newest that finished.
    NewestOfPipeline,
    /// It is among the newest of its pipeline.
    Recent,
    /// It is not old enough.
    Young,
    /// Other runs are to be removed.
    NotAsked,
}

impl Reason {
    /// Whether a limit of bytes may overrule it.
    fn yields(self) -> bool {
        matches!(self, Self::Recent | Self::Young)
    }
}

/// Why each run stays; `None` for those that go.
pub(super) fn reasons(holdings: &Holdings, policy: &Policy) -> Vec<Option<Reason>> {
    match policy {
        Policy::Drop(ids) => {
            holdings.runs.iter().map(|run| Some(Reason::NotAsked).filter(|_| !ids.contains(&run.id))).collect()
        }
        Policy::Limits(limits) => within(holdings, limits),
    }
}

fn within(holdings: &Holdings, limits: &Limits) -> Vec<Option<Reason>> {
    let runs = &holdings.runs;
    let mut reasons: Vec<Option<Reason>> = runs.iter().map(protection).collect();
    let mut pipelines: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
    for (at, run) in runs.iter().enumerate().filter(|(_, run)| run.state != Standing::Unreadable) {
        pipelines.entry(run.pipeline.as_deref().unwrap_or_default()).or_default().push(at);
    }
    for own in pipelines.values() {
        keep_recent(runs, own, limits.keep, &mut reasons);
    }
    if let Some(limit) = limits.older_than_secs {
        let started = started(runs);
        let now = utc::now_secs();
        for (reason, started) in reasons.iter_mut().zip(started) {
            let is_old = started.is_some_and(|started| now.saturating_sub(started) > limit);
            *reason = reason.or(Some(Reason::Young).filter(|_| !is_old));
        }
    }
    if let Some(max) = limits.max_bytes {
        shrink(holdings, max, &mut reasons);
    }
    reasons
}

/// Why a run stays whatever the limits are.
fn protection(run: &Holding) -> Option<Reason> {
    match run.state {
        Standing::Running => Some(Reason::Running),
        _ if run.is_pinned => Some(Reason::Pinned),
        Standing::Unreadable => Some(Reason::Unreadable),
        _ if run.is_latest => Some(Reason::Latest),
        _ => None,
    }
}

/// Keeps the newest `keep` groups of one pipeline that finished, and as many unfinished ones that are newer than those.
fn keep_recent(runs: &[Holding], own: &[usize], keep: usize, reasons: &mut [Option<Reason>]) {
    let (mut finished, mut unfinished) = (0, 0);
    for group in groups(runs, own) {
        let count = if group.is_finished() { &mut finished } else { &mut unfinished };
        *count += 1;
        if *count <= keep && (group.is_finished() || finished < keep) {
            group.members().for_each(|at| _ = reasons[at].get_or_insert(Reason::Recent));
        }
    }
    let newest_finished = own.iter().find(|&&at| runs[at].state == Standing::Finished);
    for &at in own.first().into_iter().chain(newest_finished) {
        if reasons[at] == Some(Reason::Recent) {
            reasons[at] = Some(Reason::NewestOfPipeline);
        }
    }
}

/// When each run started, in seconds. A clock that went wrong makes no run older than one before it, and a time that
/// is still to come is none.
fn started(runs: &[Holding]) -> Vec<Option<u64>> {
    let now = utc::now_secs();
    let (mut newest, mut started) = (None, Vec::new());
    for run in runs.iter().rev() {
        let own = run.started_secs.filter(|&secs| secs <= now);
        newest = newest.max(own);
        started.push(own.and(newest));
    }
    started.reverse();
    started
}

/// Gives up runs, oldest first, until what is kept takes no more than `max` bytes.
fn shrink(holdings: &Holdings, max: u64, reasons: &mut [Option<Reason>]) {
    let runs = &holdings.runs;
    let mut names: BTreeMap<Digest, usize> = BTreeMap::new();
    let mut bytes = 0;
    let objects = |at: usize| holdings.objects_of(&runs[at].results).collect::<BTreeSet<_>>();
    for at in (0..runs.len()).filter(|&at| reasons[at].is_some()) {
        bytes += runs[at].folder_bytes;
        for object in objects(at) {
            let count = names.entry(object).or_default();
            bytes += if *count == 0 { holdings.bytes(object) } else { 0 };
            *count += 1;
        }
    }
    for at in (0..runs.len()).rev() {
        if bytes <= max {
            return;
        }
        if reasons[at].is_some_and(Reason::yields) {
            reasons[at] = None;
            bytes -= runs[at].folder_bytes;
            for object in objects(at) {
                let count = names.entry(object).or_default();
                *count -= 1;
                bytes -= if *count == 0 { holdings.bytes(object) } else { 0 };
            }
        }
    }
}

/// The results that the runs that stay name.
pub(super) fn results(holdings: &Holdings, reasons: &[Option<Reason>]) -> BTreeSet<Digest> {
    let kept = holdings.runs.iter().zip(reasons).filter(|(_, reason)| reason.is_some());
    kept.flat_map(|(run, _)| run.results.iter().copied()).collect()
}
