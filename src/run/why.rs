//! Why a node has to run: what changed since the newest earlier run that had the node, with old and new values.

use std::path::{Path, PathBuf};

use serde::Serialize;
use serde_json::Value;

use super::{
    changes::{self, Change},
    key,
    manifest::Manifest,
    node::{NodeRecord, Work},
    plan::{Cause, Plan, State},
    runs,
};
use crate::{
    node_name::without_member,
    pipeline::{Graph, Node, NodeId},
};

/// How many earlier runs are searched for a node.
const RUNS_TO_READ: usize = 20;

/// Why a node has to run, or why not.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "state", rename_all = "snake_case")]
pub enum Reason {
    /// The store has its output.
    Cached,
    /// No earlier run had it.
    New,
    /// Its key is not the one of an earlier run.
    Changed {
        /// What changed.
        changes: Vec<Change>,
        /// The id of the earlier run.
        since: String,
    },
    /// Nothing changed since an earlier run, which did not finish it.
    Unfinished {
        /// The id of the earlier run.
        since: String,
    },
    /// Its output is gone or damaged.
    Unusable {
        /// What is wrong with it.
        why: String,
    },
    /// The user wants a new output.
    Forced,
    /// It takes outputs of nodes that have to run first.
    Waiting {
        /// The names of these nodes.
        on: Vec<String>,
        /// What else changed, so that the node runs whatever these nodes make.
        changes: Vec<Change>,
    },
}

impl std::fmt::Display for Reason {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Cached => f.write_str("cached"),
            Self::New => f.write_str("never ran"),
            Self::Changed { changes, .. } => f.write_str(&list(changes)),
            Self::Unfinished { since } => write!(f, "run {since} did not finish it"),
            Self::Unusable { why } => f.write_str(why),
            Self::Forced => f.write_str("forced"),
            Self::Waiting { on, changes } => {
                if !changes.is_empty() {
                    write!(f, "{}; ", list(changes))?;
                }
                match &on[..] {
                    [] => f.write_str("waits"),
                    [one] => write!(f, "waits for {one}"),
                    [one, rest @ ..] => write!(f, "waits for {one} and {} more", rest.len()),
                }
            }
        }
    }
}

fn list(changes: &[Change]) -> String {
    changes.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")
}

/// Earlier runs, newest first. A manifest is read when a node needs it.
#[derive(Debug)]
pub struct History {
    runs: PathBuf,
    unread: Option<std::vec::IntoIter<String>>,
    read: Vec<Manifest>,
}

impl History {
    /// The runs below a folder.
    pub fn new(runs: &Path) -> Self {
        Self { runs: runs.to_owned(), unread: None, read: Vec::new() }
    }

    /// The newest earlier run that had a node: of the same pipeline if possible, by name or else by stage and round. A
    /// pipeline is the same whether it runs alone or in a suite.
    fn newest(&mut self, pipeline: &str, node: &Node) -> Option<(&Manifest, &NodeRecord)> {
        let (name, stage) = (without_member(&node.name), without_member(&node.stage));
        let is_it = |record: &NodeRecord, by_name_only: bool| {
            let (old, key) = (&record.about, record.outcome.key);
            let by_stage = without_member(&old.stage) == stage && old.round == node.round && !by_name_only;
            old.work.kind == node.kind.name && key.is_some() && (without_member(&old.name) == name || by_stage)
        };
        for by_name_only in [true, false] {
            for at in 0.. {
                let Some(manifest) = self.nth(at) else { break };
                let matches = |record: &NodeRecord| {
                    manifest.members[record.about.member].pipeline == pipeline && is_it(record, by_name_only)
                };
                if let Some(row) = manifest.nodes.iter().position(matches) {
                    return Some((&self.read[at], &self.read[at].nodes[row]));
                }
            }
        }
        // A run of another pipeline counts only if it is about the same environment.
        let is_like = |record: &NodeRecord| record.about.work.task.name() == node.task.name() && is_it(record, true);
        let row = |manifest: &Manifest| manifest.nodes.iter().position(is_like);
        let (at, row) = self.read.iter().enumerate().find_map(|(at, manifest)| Some((at, row(manifest)?)))?;
        Some((&self.read[at], &self.read[at].nodes[row]))
    }

    fn nth(&mut self, at: usize) -> Option<&Manifest> {
        let runs = &self.runs;
        let unread = self.unread.get_or_insert_with(|| runs::list(runs).unwrap_or_default().into_iter());
        while self.read.len() <= at && self.read.len() < RUNS_TO_READ {
            let id = unread.next()?;
            self.read.extend(Manifest::read(&self.runs.join(id)).ok());
        }
        self.read.get(at)
    }
}

/// Why a node is in its state in a plan; `None` for a node that is not wanted.
pub fn reason(graph: &Graph, plan: &Plan, id: NodeId, history: &mut History) -> Option<Reason> {
    let node = &graph.nodes[id];
    Some(match plan[id].as_ref()? {
        State::Hit(..) => Reason::Cached,
        State::Stale(_, Cause::Forced) => Reason::Forced,
        State::Stale(_, Cause::Unusable(why)) => Reason::Unusable { why: why.clone() },
        State::Stale(key, Cause::Missing) => match history.newest(&graph.members[node.member].pipeline, node) {
            None => Reason::New,
            Some((manifest, record)) => {
                let changes = changes::between(&manifest.key_of(record), &key.json);
                let since = manifest.run.clone();
                if !changes.is_empty() {
                    Reason::Changed { changes: name_inputs(node, graph, changes), since }
                } else if record.outcome.output.is_some() {
                    Reason::Unusable { why: "its entry is gone".to_owned() }
                } else {
                    Reason::Unfinished { since }
                }
            }
        },
        State::Waiting(on) => Reason::Waiting {
            on: on.iter().map(|&source| graph.nodes[source].name.clone()).collect(),
            changes: history.newest(&graph.members[node.member].pipeline, node).map_or_else(
                Vec::new,
                |(manifest, record)| {
                    let mut old = manifest.key_of(record);
                    old["inputs"] = Value::Null;
                    changes::between(&old, &key::without_inputs(&Work::of(node)))
                },
            ),
        },
    })
}

/// Names the source of each input that changed, as far as positions show it.
fn name_inputs(node: &Node, graph: &Graph, changes: Vec<Change>) -> Vec<Change> {
    let mut named = Vec::new();
    for change in changes {
        let port =
            change.path.strip_prefix("input ").and_then(|name| node.inputs.iter().find(|(port, _)| port.name == name));
        let (Some((port, sources)), Some(old), Some(new)) = (port, change.old.as_array(), change.new.as_array()) else {
            named.push(change);
            continue;
        };
        for at in 0..old.len().max(new.len()) {
            let (old, new) = (old.get(at).cloned().unwrap_or_default(), new.get(at).cloned().unwrap_or_default());
            if old != new {
                let source =
                    sources.get(at).map_or_else(|| format!("{at}"), |&source| graph.nodes[source].name.clone());
                named.push(Change { path: format!("input {} ({source})", port.name), old, new });
            }
        }
    }
    named
}
