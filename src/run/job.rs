//! A job: the work of one node as plain data, complete enough to be written down and done in another process.

use serde::{Deserialize, Serialize};

use super::{key, node::Work};
use crate::{
    digest::Digest,
    pipeline::{Node, NodeFile},
    store::{Entry, Key},
};

/// The work of one node, with its inputs by digest.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Job {
    /// The name of the node, for events and recordings.
    pub node: String,
    /// The round of the loop.
    pub round: Option<u32>,
    /// What to do.
    #[serde(flatten)]
    pub work: Work,
    /// The inputs of each port, in the order of the ports.
    pub inputs: Vec<JobPort>,
    /// The files that its parameters name.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub files: Vec<NodeFile>,
    /// The most threads that the job may use. Their number changes no result.
    pub threads: usize,
}

/// The inputs of one port.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct JobPort {
    /// The name of the port.
    pub port: String,
    /// Its inputs, in the order written in the pipeline.
    pub inputs: Vec<JobInput>,
}

/// One input of a job.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct JobInput {
    /// The content digest of the input.
    pub content: Digest,
    /// The key that made it. The store has its entry, and a damaged input is made again under this key.
    pub made_by: Digest,
}

impl From<&Entry> for JobInput {
    fn from(entry: &Entry) -> Self {
        Self { content: entry.output, made_by: entry.key_digest }
    }
}

impl Job {
    /// The job of a node whose inputs are in the store; `inputs` are in the order of the node's ports.
    pub fn of(node: &Node, inputs: Vec<Vec<JobInput>>, threads: usize) -> Self {
        let ports = node.inputs.iter().map(|(port, _)| port.name.to_owned());
        Self {
            node: node.name.clone(),
            round: node.round,
            work: Work::of(node),
            inputs: ports.zip(inputs).map(|(port, inputs)| JobPort { port, inputs }).collect(),
            files: node.files.clone(),
            threads,
        }
    }

    /// The key of the job's result.
    pub fn key(&self) -> Key {
        let digests = |port: &JobPort| port.inputs.iter().map(|input| input.content).collect();
        key::of_work(&self.work, self.inputs.iter().map(|port| (port.port.as_str(), digests(port))))
    }
}
