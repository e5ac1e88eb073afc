//! Why a node has to run: what changed since the earlier run whose node is nearest to it, with old and new values.

use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
};

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

/// Which part of a key is compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Part {
    /// All of it.
    Whole,
    /// All but the inputs, which are not known yet.
    WithoutInputs,
}

/// A node of an earlier run, and what has changed since.
#[derive(Debug)]
struct Nearest {
    run: String,
    has_output: bool,
    changes: Vec<Change>,
}

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

/// Earlier runs, newest first. They are read once a node has to run.
#[derive(Debug)]
pub struct History {
    unread: Option<PathBuf>,
    read: Vec<Manifest>,
}

impl History {
    /// The runs below a folder.
    pub fn new(runs: &Path) -> Self {
        Self { unread: Some(runs.to_owned()), read: Vec::new() }
    }

    /// The node of an earlier run that differs least from a node with this key; of several, that of the newest run. Runs
    /// of the same pipeline come first, by the name of the node or else by stage and round. A pipeline is the same
    /// whether it runs alone or in a suite.
    fn nearest(&mut self, pipeline: &str, node: &Node, key: &Value, part: Part) -> Option<Nearest> {
        let (name, stage) = (without_member(&node.name), without_member(&node.stage));
        self.read_all();
        let is_it = |record: &NodeRecord, by_name_only: bool| {
            let (old, key) = (&record.about, record.outcome.key);
            let by_stage = without_member(&old.stage) == stage && old.round == node.round && !by_name_only;
            old.work.kind == node.kind.name && key.is_some() && (without_member(&old.name) == name || by_stage)
        };
        let is_own =
            |manifest: &Manifest, record: &NodeRecord| manifest.members[record.about.member].pipeline == pipeline;
        // A run of another pipeline counts only if it is about the same environment.
        let is_like = |record: &NodeRecord| record.about.work.task.name() == node.task.name();
        self.least(key, part, |manifest, record| is_own(manifest, record) && is_it(record, true))
            .or_else(|| self.least(key, part, |manifest, record| is_own(manifest, record) && is_it(record, false)))
            .or_else(|| self.least(key, part, |_, record| is_like(record) && is_it(record, true)))
    }

    /// Of the first node of each run that is `wanted`, the one that differs least.
    fn least(&self, key: &Value, part: Part, wanted: impl Fn(&Manifest, &NodeRecord) -> bool) -> Option<Nearest> {
        let mut compared = BTreeSet::new();
        let mut nearest: Option<Nearest> = None;
        for manifest in &self.read {
            let Some(record) = manifest.nodes.iter().find(|record| wanted(manifest, record)) else { continue };
            // Runs that only used a result have the same key.
            if !compared.insert((record.outcome.key, record.outcome.output)) {
                continue;
            }
            let mut old = manifest.key_of(record);
            if part == Part::WithoutInputs {
                old["inputs"] = Value::Null;
            }
            let changes = changes::between(&old, key);
            if nearest.as_ref().is_none_or(|nearest| changes.len() < nearest.changes.len()) {
                nearest =
                    Some(Nearest { run: manifest.run.clone(), has_output: record.outcome.output.is_some(), changes });
            }
        }
        nearest
    }

    /// Reads the newest runs, once.
    fn read_all(&mut self) {
        if let Some(runs) = self.unread.take() {
            let manifests = runs::manifests(&runs).into_iter().flatten().filter_map(|(_, manifest)| manifest.ok());
            self.read = manifests.take(RUNS_TO_READ).collect();
        }
    }
}

/// Why a node is in its state in a plan; `None` for a node that is not wanted.
pub fn reason(graph: &Graph, plan: &Plan, id: NodeId, history: &mut History) -> Option<Reason> {
    let node = &graph.nodes[id];
    Some(match plan[id].as_ref()? {
        State::Hit(..) => Reason::Cached,
        State::Stale(_, Cause::Forced) => Reason::Forced,
        State::Stale(_, Cause::Unusable(why)) => Reason::Unusable { why: why.clone() },
        State::Stale(key, Cause::Missing) => {
            let Some(Nearest { run: since, has_output, changes }) =
                history.nearest(&graph.members[node.member].pipeline, node, &key.json, Part::Whole)
            else {
                return Some(Reason::New);
            };
            if !changes.is_empty() {
                Reason::Changed { changes: name_inputs(node, graph, changes), since }
            } else if has_output {
                Reason::Unusable { why: "its entry is gone".to_owned() }
            } else {
                Reason::Unfinished { since }
            }
        }
        State::Waiting(on) => {
            let key = key::without_inputs(&Work::of(node));
            let nearest = history.nearest(&graph.members[node.member].pipeline, node, &key, Part::WithoutInputs);
            Reason::Waiting {
                on: on.iter().map(|&source| graph.nodes[source].name.clone()).collect(),
                changes: nearest.map_or_else(Vec::new, |nearest| nearest.changes),
            }
        }
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
