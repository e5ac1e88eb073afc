//! Computes the key of a result before the result exists: a hash over everything that can change it.
//!
//! A key holds no clock, path, host, locale, number of threads or number of jobs.

use std::borrow::Cow;

use serde_json::{Value, json};

use super::node::Work;
use crate::{
    digest::Digest,
    env::Task,
    num::rng::Stream,
    pipeline::{Node, NodeId},
    store::Key,
};

/// A member of the JSON of a key.
type Member<'a> = (&'static str, Cow<'a, Value>);

/// The key of a node, once the content of every input is known; `None` before.
pub fn of_node(node: &Node, content: impl Fn(NodeId) -> Option<Digest>) -> Option<Key> {
    members_of_node(node, content).map(|members| Key::of_json(object(members)))
}

/// The digest of the key of a node. The key itself is not built, which saves time.
pub(super) fn digest_of_node(node: &Node, content: impl Fn(NodeId) -> Option<Digest>) -> Option<Digest> {
    let members = members_of_node(node, content)?;
    Some(Digest::of_members(members.iter().map(|(name, value)| (*name, &**value))))
}

/// The key of work on inputs: each port with the content digests of its inputs.
pub fn of_work<'a>(work: &Work, ports: impl IntoIterator<Item = (&'a str, Vec<Digest>)>) -> Key {
    Key::of_json(with_inputs(work, inputs(ports)))
}

/// The part of a key that is known before the inputs exist.
pub fn without_inputs(work: &Work) -> Value {
    object(members_of_work(work))
}

/// The JSON of a key.
pub(super) fn with_inputs(work: &Work, inputs: Value) -> Value {
    let mut json = without_inputs(work);
    json["inputs"] = inputs;
    json
}

fn members_of_node(node: &Node, content: impl Fn(NodeId) -> Option<Digest>) -> Option<Vec<Member<'_>>> {
    let mut ports = Vec::with_capacity(node.inputs.len());
    for (port, sources) in &node.inputs {
        let digests: Option<Vec<Digest>> = sources.iter().map(|&source| content(source)).collect();
        ports.push((port.name, digests?));
    }
    let kind = (node.kind.name, node.kind.version);
    let mut members = members(kind, &node.params, &node.task, &node.stream, node.platform);
    members.push(("inputs", Cow::Owned(inputs(ports))));
    Some(members)
}

fn members_of_work(work: &Work) -> Vec<Member<'_>> {
    members((&work.kind, work.version), &work.params, &work.task, &work.stream, &work.platform)
}

/// All members except the inputs, in the order in which people read them.
fn members<'a>(
    (kind, version): (&str, u32),
    params: &'a Value,
    task: &Task,
    stream: &Stream,
    platform: &str,
) -> Vec<Member<'a>> {
    vec![
        ("kind", Cow::Owned(kind.into())),
        ("version", Cow::Owned(version.into())),
        ("params", Cow::Borrowed(params)),
        ("task", Cow::Owned(Value::Object(task.in_key()))),
        ("stream", Cow::Owned(json!(stream))),
        ("platform", Cow::Owned(platform.into())),
    ]
}

fn inputs<'a>(ports: impl IntoIterator<Item = (&'a str, Vec<Digest>)>) -> Value {
    // A port without inputs stays out of the key, so that a kind may gain an optional port.
    let used = ports.into_iter().filter(|(_, digests)| !digests.is_empty());
    used.map(|(port, digests)| (port, digests.iter().map(Digest::to_string).collect::<Value>())).collect()
}

fn object(members: Vec<Member<'_>>) -> Value {
    members.into_iter().map(|(name, value)| (name, value.into_owned())).collect()
}
