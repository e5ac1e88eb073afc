//! Runs a recorded run again, in an empty store and from its manifest alone, and compares every output and recording.

use std::path::Path;

use serde::Serialize;

use super::{
    events::{Listener, NodeState},
    execute::{self, Options, Order, Report},
    manifest::Manifest,
    node::NodeRecord,
    runs,
};
use crate::{
    digest::Digest,
    stage::Kind,
    store::{Entry, LocalStore, ResultStore},
};

/// What a replay found.
#[derive(Debug)]
pub struct Replayed {
    /// The run in the empty store.
    pub report: Report,
    /// How many nodes gave the same output and recording.
    pub equal: usize,
    /// What differs, in the order of the graph.
    pub differences: Vec<Difference>,
    /// The nodes whose recording failed in the replay. These recordings could not be compared.
    pub unrecorded: Vec<String>,
}

/// Something of a node that differs in the replay.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Difference {
    /// The name of the node.
    pub node: String,
    /// `output`, `recording`, or the name of a file such as `model.safetensors`.
    pub what: String,
    /// The digest in the run.
    pub recorded: Digest,
    /// The digest in the replay; `None` if it has none.
    pub replayed: Option<Digest>,
}

/// Replays a run in the empty folder `scratch`. `store`, which holds the results of the run, only tells which file of
/// an output differs.
///
/// # Errors
/// The run used a kind or a version that this carl-pipe does not have, or the system failed.
pub fn replay(
    manifest: &Manifest,
    store: &dyn ResultStore,
    scratch: &Path,
    options: &Options,
    kind: &dyn Fn(&str) -> Option<&'static Kind>,
    listener: &dyn Listener,
) -> anyhow::Result<Replayed> {
    let graph = manifest.graph(kind)?;
    // What the run did not finish cannot be compared, and nothing that it finished needs it.
    let wanted = manifest.nodes.iter().map(|record| record.outcome.output.is_some()).collect();
    let order = Order { graph: &graph, wanted, text: &manifest.text, argv: manifest.argv.clone(), note: None };
    let new_store = LocalStore::open(scratch)?;
    let report = execute::run(&new_store, &runs::folder(scratch), &order, options, listener)?;
    let (mut equal, mut differences, mut unrecorded) = (0, Vec::new(), Vec::new());
    for new in &report.manifest.nodes {
        let Some(old) = manifest.node(&new.about.name) else { continue };
        if !matches!(new.outcome.state, NodeState::Ran | NodeState::Cached) {
            continue;
        }
        let found = compare([old, new], [store, &new_store])?;
        let is_recorded = old.outcome.recording.is_none() || new.outcome.recording.is_some();
        if !is_recorded {
            unrecorded.push(new.about.name.clone());
        }
        equal += usize::from(found.is_empty() && is_recorded);
        differences.extend(found);
    }
    Ok(Replayed { report, equal, differences, unrecorded })
}

/// What differs between a node of the run and the same node of the replay.
fn compare([old, new]: [&NodeRecord; 2], stores: [&dyn ResultStore; 2]) -> anyhow::Result<Vec<Difference>> {
    let difference = |what: &str, recorded, replayed| Difference {
        node: old.about.name.clone(),
        what: what.to_owned(),
        recorded,
        replayed,
    };
    let mut found = Vec::new();
    let (before, now) = (&old.outcome, &new.outcome);
    if let Some(recorded) = before.output.filter(|_| before.output != now.output) {
        if let (Some(before), Some(now)) = (entry(old, stores[0])?, entry(new, stores[1])?) {
            for file in &before.files {
                let other = now.files.iter().find(|other| other.name == file.name).map(|other| other.object);
                if other != Some(file.object) {
                    found.push(difference(&file.name, file.object, other));
                }
            }
        }
        if found.is_empty() {
            found.push(difference("output", recorded, now.output));
        }
    }
    if let (Some(recorded), Some(replayed)) = (before.recording, now.recording)
        && recorded != replayed
    {
        found.push(difference("recording", recorded, Some(replayed)));
    }
    Ok(found)
}

/// The entry of what a node made, if the store still has it.
fn entry(record: &NodeRecord, store: &dyn ResultStore) -> anyhow::Result<Option<Entry>> {
    let entry = record.outcome.key.map(|key| store.entry(key)).transpose()?.flatten();
    Ok(entry.filter(|entry| Some(entry.output) == record.outcome.output))
}
