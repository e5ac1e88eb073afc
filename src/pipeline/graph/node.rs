//! The graph that a pipeline unrolls into.

use std::{collections::BTreeMap, path::PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::{
    digest::Digest,
    env::Task,
    node_name::without_member,
    num::rng::Stream,
    stage::{Kind, Port},
};

/// The index of a node in [`Graph::nodes`].
pub type NodeId = usize;

/// A checked pipeline, unrolled into nodes.
#[derive(Debug, Clone, Default)]
pub struct Graph {
    /// `name` of the file.
    pub name: String,
    /// `description` of the file.
    pub description: String,
    /// The pipelines in the graph: one, or those of a suite.
    pub members: Vec<Member>,
    /// The nodes. Every node comes after those whose results it takes.
    pub nodes: Vec<Node>,
}

/// A pipeline in a graph. The keys of nodes hold nothing of it.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Member {
    /// Its name in the suite. Empty where the graph is this pipeline alone.
    pub name: String,
    /// `name` of its file.
    pub pipeline: String,
    /// The path of its file.
    pub file: String,
    /// `[labels]` of its file; labels of the suite replace those of the same name.
    #[serde(default)]
    pub labels: BTreeMap<String, String>,
    /// The text of its file. Empty where this is the file that was loaded.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub text: String,
    /// The file that its file extends.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub base: Option<BaseFile>,
}

/// The file that a pipeline extends.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct BaseFile {
    /// Its path.
    pub file: String,
    /// Its text.
    pub text: String,
}

impl Graph {
    /// Whether the graph was made from a suite.
    pub fn is_suite(&self) -> bool {
        self.members.iter().any(|member| !member.name.is_empty())
    }

    /// Whether a target means a node. A target is the name of a node, a stage, a member of a suite, or a stage in all
    /// members.
    pub fn is_named(&self, id: NodeId, target: &str) -> bool {
        let node = &self.nodes[id];
        let member = &self.members[node.member].name;
        if member.is_empty() {
            return node.stage == target || node.name == target;
        }
        [member.as_str(), node.stage.as_str(), node.name.as_str(), without_member(&node.stage)].contains(&target)
    }
}

/// One execution of one stage: the stage in one round, at one point of the matrix.
#[derive(Debug, Clone)]
pub struct Node {
    /// `represent`, `represent@3` or `represent@3[seed=2]`; in a suite after its member, `planar_online/represent@3`.
    /// Names are unique in a graph.
    pub name: String,
    /// The stage's name in the file; in a suite after its member, `planar_online/represent`.
    pub stage: String,
    /// Index into [`Graph::members`].
    pub member: usize,
    /// The round, where the stage is in the loop.
    pub round: Option<u32>,
    /// The point of the matrix: axis and value, only of the axes that reach this node.
    pub point: Vec<(String, String)>,
    /// The kind of work.
    pub kind: &'static Kind,
    /// Every parameter, defaults written out.
    pub params: Value,
    /// The task, defaults written out.
    pub task: Task,
    /// The files that its parameters name.
    pub files: Vec<NodeFile>,
    /// The node's random stream.
    pub stream: Stream,
    /// The arithmetic that its result depends on: [`crate::num::PLATFORM`].
    pub platform: &'static str,
    /// The nodes connected to each port, in the order written. An optional port may have none.
    pub inputs: Vec<(&'static Port, Vec<NodeId>)>,
    /// True for nodes of the last round and of stages outside of the loop: their results are the pipeline's.
    pub is_last: bool,
}

/// A file outside of the pipeline file whose content is part of a key.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct NodeFile {
    /// The digest of its content.
    pub content: Digest,
    /// Where it lay when the graph was made.
    pub place: PathBuf,
}
