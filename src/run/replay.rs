//! Runs a recorded run again, in an empty store and from its manifest alone, and compares every output and recording.

use serde::Serialize;

use super::{
    events::{Listener, NodeState},
    execute::{self, Options, Order, Report},
    manifest::{Manifest, NodeRecord},
};
use crate::store::{Entry, Store};
use crate::{digest::Digest, stage::Kind};

/// What a replay found.
#[derive(Debug)]
pub struct Replayed {
    /// The run in the empty store.
    pub report: Report,
    /// Nodes that gave the same output and recording.
    pub equal: usize,
    /// Nodes that did not, in the order of the graph.
    pub differences: Vec<Difference>,
}

/// A node whose replay gave something else.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Difference {
    /// The node.
    pub node: String,
    /// `model.safetensors`, `output` or `recording`.
    pub what: String,
    /// Its digest in the run.
    pub recorded: Digest,
    /// Its digest now; none if there is none.
    pub replayed: Option<Digest>,
}

/// Replays a run in the empty store `scratch`; `store` is asked only which file of an output differs.
///
/// # Errors
/// A kind or version that is no more, or what the system says.
pub fn replay(
    manifest: &Manifest,
    store: &Store,
    scratch: &Store,
    options: &Options,
    kind: &dyn Fn(&str) -> Option<&'static Kind>,
    listener: &dyn Listener,
) -> anyhow::Result<Replayed> {
    let graph = manifest.graph(kind)?;
    // What the run did not finish cannot be compared, and nothing finished needs it.
    let wanted = manifest.nodes.iter().map(|node| node.output.is_some()).collect();
    let order = Order { graph: &graph, wanted, text: &manifest.text, argv: manifest.argv.clone() };
    let report = execute::run(scratch, &order, options, listener)?;
    let (mut equal, mut differences) = (0, Vec::new());
    let replayed = Manifest::read(&report.path)?;
    for new in replayed.nodes.iter().filter(|node| matches!(node.state, NodeState::Ran | NodeState::Cached)) {
        let Some(old) = manifest.nodes.iter().find(|node| node.name == new.name) else { continue };
        let found = compare(old, new, store, scratch)?;
        equal += usize::from(found.is_empty());
        differences.extend(found);
    }
    Ok(Replayed { report, equal, differences })
}

fn compare(old: &NodeRecord, new: &NodeRecord, store: &Store, scratch: &Store) -> anyhow::Result<Vec<Difference>> {
    let mut found = Vec::new();
    let difference = |what: &str, recorded, replayed| Difference {
        node: old.name.clone(),
        what: what.to_owned(),
        recorded,
        replayed,
    };
    if let Some(recorded) = old.output.filter(|_| old.output != new.output) {
        let files = |store: &Store, node: &NodeRecord| -> anyhow::Result<Option<Entry>> {
            node.key
                .map_or(Ok(None), |key| store.entry(key))
                .map(|entry| entry.filter(|it| Some(it.output) == node.output))
        };
        if let (Some(before), Some(now)) = (files(store, old)?, files(scratch, new)?) {
            for file in &before.files {
                let other = now.files.iter().find(|other| other.name == file.name).map(|other| other.object);
                if other != Some(file.object) {
                    found.push(difference(&file.name, file.object, other));
                }
            }
        }
        if found.is_empty() {
            found.push(difference("output", recorded, new.output));
        }
    }
    if let Some(recorded) = old.recording.filter(|_| old.recording != new.recording) {
        found.push(difference("recording", recorded, new.recording));
    }
    Ok(found)
}
