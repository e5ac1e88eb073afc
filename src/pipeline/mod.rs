//! A pipeline file, read and unrolled: `text -> parse -> expand -> check` gives a [`Graph`] of nodes, or all mistakes.

use serde_json::Value;

use crate::{env::Task, rng::Stream, stage::{Kind, Port}};

/// The index of a node in [`Graph::nodes`].
pub type NodeId = usize;

/// A checked pipeline, unrolled into nodes.
#[derive(Debug, Clone)]
pub struct Graph {
    /// `name` of the file.
    pub name: String,
    /// `description` of the file.
    pub description: String,
    /// Nodes in an order in which every input comes before what takes it.
    pub nodes: Vec<Node>,
}

/// One execution of one stage: a stage in one round, at one point of the matrix.
#[derive(Debug, Clone)]
pub struct Node {
    /// `represent`, `represent@3` or `represent@3[seed=2]`: unique in the graph.
    pub name: String,
    /// The stage's name in the file.
    pub stage: String,
    /// The round, where the stage is in the loop.
    pub round: Option<u32>,
    /// The point of the matrix: axis and value, only those axes that reach this node.
    pub point: Vec<(String, String)>,
    /// What it does.
    pub kind: &'static Kind,
    /// Every parameter, defaults written out.
    pub params: Value,
    /// The task, defaults written out.
    pub task: Task,
    /// The node's randomness.
    pub stream: Stream,
    /// What is connected to each port, in the order written; an optional port without a source has an empty list.
    pub inputs: Vec<(&'static Port, Vec<NodeId>)>,
    /// True for nodes of the last round and for stages outside of the loop: where results are read off.
    pub is_last: bool,
}
