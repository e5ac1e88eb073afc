//! What a run says about a node: its description, and what became of it.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::events::NodeState;
use crate::{
    digest::Digest,
    env::Task,
    num::{self, rng::Stream},
    pipeline::{Graph, Node},
    stage::Kind,
    store::Entry,
};

/// The work of a node: everything but its inputs that can change its result.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Work {
    /// The kind of stage.
    pub kind: String,
    /// The version of the kind.
    pub version: u32,
    /// Every parameter, defaults written out.
    pub params: Value,
    /// The task, defaults written out.
    pub task: Task,
    /// The randomness of the node.
    pub stream: Stream,
    /// The arithmetic that the result depends on. Manifests name it since it belongs to a node.
    #[serde(default = "usual_platform")]
    pub platform: String,
}

fn usual_platform() -> String {
    num::PLATFORM.to_owned()
}

impl Work {
    /// The work of a node.
    pub fn of(node: &Node) -> Self {
        Self {
            kind: node.kind.name.to_owned(),
            version: node.kind.version,
            params: node.params.clone(),
            task: node.task.clone(),
            stream: node.stream.clone(),
            platform: node.platform.to_owned(),
        }
    }

    /// Its kind, with the output that it has here.
    pub fn kind_among<'k>(&self, kinds: &'k [Kind]) -> Option<&'k Kind> {
        let kind = kinds.iter().find(|kind| kind.name == self.kind)?;
        Some(kind.declared(&self.params, []))
    }
}

/// A node as manifests and reports describe it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NodeDescription {
    /// The name of the node. See [`Node::name`].
    pub name: String,
    /// The stage. See [`Node::stage`].
    pub stage: String,
    /// The member of a suite. See [`Node::member`].
    #[serde(default)]
    pub member: usize,
    /// The round of the loop. See [`Node::round`].
    pub round: Option<u32>,
    /// The point of the matrix. See [`Node::point`].
    pub point: Vec<(String, String)>,
    /// What it does.
    #[serde(flatten)]
    pub work: Work,
    /// The names of the nodes connected to each port.
    pub inputs: BTreeMap<String, Vec<String>>,
    /// Whether results are read off this node. See [`Node::is_last`].
    pub is_last: bool,
}

impl NodeDescription {
    /// The description of a node of a graph.
    pub fn of(node: &Node, graph: &Graph) -> Self {
        let names = |sources: &[usize]| sources.iter().map(|&source| graph.nodes[source].name.clone()).collect();
        Self {
            name: node.name.clone(),
            stage: node.stage.clone(),
            member: node.member,
            round: node.round,
            point: node.point.clone(),
            work: Work::of(node),
            inputs: node.inputs.iter().map(|(port, sources)| (port.name.to_owned(), names(sources))).collect(),
            is_last: node.is_last,
        }
    }
}

/// What became of a node.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NodeOutcome {
    /// How it ended.
    pub state: NodeState,
    /// The digest of its key, once the key is known.
    pub key: Option<Digest>,
    /// The content digest of its output, once there is one.
    pub output: Option<Digest>,
    /// The digest of the messages in its recording.
    pub recording: Option<Digest>,
    /// Its metrics.
    #[serde(rename = "figures")]
    pub metrics: BTreeMap<String, f64>,
    /// Seconds that it took to make the output, in this run or an earlier one.
    pub secs: f64,
    /// Seconds of these that the recorder took.
    pub recorder_secs: f64,
}

impl NodeOutcome {
    /// The outcome of a node that has not run.
    pub(super) fn pending() -> Self {
        Self {
            state: NodeState::Pending,
            key: None,
            output: None,
            recording: None,
            metrics: BTreeMap::new(),
            secs: 0.0,
            recorder_secs: 0.0,
        }
    }

    /// Notes that a node ended without an output.
    pub(super) fn end_without_output(&mut self, state: NodeState, key: Digest) {
        *self = Self { state, key: Some(key), ..Self::pending() };
    }

    /// Notes that a node has an output.
    pub(super) fn end_with(&mut self, state: NodeState, entry: &Entry) {
        *self = Self {
            state,
            key: Some(entry.key_digest),
            output: Some(entry.output),
            recording: entry.recording.as_ref().map(|recording| recording.messages),
            metrics: entry.metrics.clone(),
            secs: entry.secs,
            recorder_secs: entry.recorder_secs,
        };
    }
}

/// A node of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NodeRecord {
    /// What the node is.
    #[serde(flatten)]
    pub about: NodeDescription,
    /// What became of it.
    #[serde(flatten)]
    pub outcome: NodeOutcome,
}
