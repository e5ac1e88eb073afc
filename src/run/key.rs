//! Computes the key of a result before the result exists: a hash over everything that can change it.
//!
//! A key holds no clock, path, host, locale, number of threads or number of jobs.

use serde_json::{Map, Value, json};

use super::node::Work;
use crate::{
    digest::Digest,
    env::Task,
    num::rng::Stream,
    pipeline::{Node, NodeId},
    store::Key,
};

/// The key of a node, once the content of every input is known; `None` before.
pub fn of_node(node: &Node, content: impl Fn(NodeId) -> Option<Digest>) -> Option<Key> {
    let mut inputs = Vec::with_capacity(node.inputs.len());
    for (port, sources) in &node.inputs {
        let digests: Option<Vec<Digest>> = sources.iter().map(|&source| content(source)).collect();
        inputs.push((port.name, digests?));
    }
    let kind = (node.kind.name, node.kind.version);
    Some(of_parts(parts(kind, &node.params, &node.task, &node.stream, node.platform), inputs))
}

/// The key of work on inputs: each port with the content digests of its inputs.
pub fn of_work<'a>(work: &Work, inputs: impl IntoIterator<Item = (&'a str, Vec<Digest>)>) -> Key {
    of_parts(without_inputs(work), inputs)
}

fn of_parts<'a>(mut json: Value, inputs: impl IntoIterator<Item = (&'a str, Vec<Digest>)>) -> Key {
    let mut by_port = Map::new();
    // A port without inputs stays out of the key, so that a kind may gain an optional port.
    for (port, digests) in inputs.into_iter().filter(|(_, digests)| !digests.is_empty()) {
        by_port.insert(port.to_owned(), digests.iter().map(|digest| Value::from(digest.to_string())).collect());
    }
    json["inputs"] = Value::Object(by_port);
    Key::of_json(json)
}

/// The part of a key that is known before the inputs exist.
pub fn without_inputs(work: &Work) -> Value {
    parts((&work.kind, work.version), &work.params, &work.task, &work.stream, &work.platform)
}

fn parts((kind, version): (&str, u32), params: &Value, task: &Task, stream: &Stream, platform: &str) -> Value {
    let mut json = json!({ "kind": kind, "version": version });
    json["params"] = params.clone();
    json["task"] = json!(task);
    json["stream"] = json!(stream);
    json["platform"] = platform.into();
    json
}

/// The JSON of a key.
pub(super) fn with_inputs(work: &Work, inputs: Value) -> Value {
    let mut json = without_inputs(work);
    json["inputs"] = inputs;
    json
}
