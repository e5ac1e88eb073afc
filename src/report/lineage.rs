//! The lineage of a result: the nodes that it was made from, their samples, and digests of their recipe.

use std::collections::{BTreeMap, BTreeSet};

use serde_json::json;

use super::point::{without_samples, without_seed};
use crate::{
    digest::{self, Digest},
    node_name::without_member,
    run::{manifest::Manifest, node::NodeRecord},
    stage::Kind,
};

/// The artifact by which samples are counted.
const TRANSITIONS: &str = "transitions";

/// The nodes of a run, by name.
pub(super) struct Lineage<'a> {
    manifest: &'a Manifest,
    kinds: &'a [Kind],
    by_name: BTreeMap<&'a str, usize>,
}

impl<'a> Lineage<'a> {
    pub(super) fn new(manifest: &'a Manifest, kinds: &'a [Kind]) -> Self {
        let by_name = manifest.nodes.iter().enumerate().map(|(id, node)| (node.about.name.as_str(), id)).collect();
        Self { manifest, kinds, by_name }
    }

    /// A node and all nodes that it was made from.
    pub(super) fn upstream(&self, id: usize) -> BTreeSet<usize> {
        let (mut found, mut open) = (BTreeSet::from([id]), vec![id]);
        while let Some(id) = open.pop() {
            for source in self.manifest.nodes[id].about.inputs.values().flatten() {
                if let Some(&source) = self.by_name.get(source.as_str())
                    && found.insert(source)
                {
                    open.push(source);
                }
            }
        }
        found
    }

    /// The number of transitions made upstream. Nodes with equal keys count once, since they were sampled once.
    pub(super) fn samples(&self, upstream: &BTreeSet<usize>) -> u64 {
        let makes =
            |node: &NodeRecord| self.kinds.iter().any(|it| it.name == node.about.work.kind && it.gives(TRANSITIONS));
        let mut counted = BTreeSet::new();
        let data = upstream.iter().map(|&id| &self.manifest.nodes[id]).filter(|node| makes(node));
        data.filter(|node| node.outcome.key.is_none_or(|key| counted.insert(key)))
            .filter_map(|node| node.about.work.params["samples"].as_u64())
            .sum()
    }

    /// A digest of everything upstream except seeds.
    pub(super) fn recipe(&self, upstream: &BTreeSet<usize>) -> Digest {
        let place = |name: &String| {
            let node = self.by_name.get(name.as_str()).map(|&id| &self.manifest.nodes[id]);
            node.map(|node| json!([without_member(&node.about.stage), node.about.round]))
        };
        let step = |node: &NodeRecord| {
            let inputs: BTreeMap<&String, Vec<_>> =
                node.about.inputs.iter().map(|(port, names)| (port, names.iter().map(place).collect())).collect();
            digest::canonical(&json!([
                without_member(&node.about.stage),
                node.about.round,
                node.about.work.kind,
                node.about.work.version,
                node.about.work.params,
                node.about.work.task,
                node.about.work.stream.stream,
                inputs
            ]))
        };
        let steps: BTreeSet<String> = upstream.iter().map(|&id| step(&self.manifest.nodes[id])).collect();
        Digest::of_json(&json!(steps))
    }

    /// A digest of the pipeline at a node's point, except rounds, seeds and numbers of samples.
    pub(super) fn family(&self, node: &NodeRecord) -> Digest {
        let own = without_samples(without_seed(node));
        let is_beside = |other: &&NodeRecord| {
            let differs = |(axis, value): &(String, String)| own.iter().any(|(mine, it)| mine == axis && it != value);
            other.about.member == node.about.member
                && other.about.work.task == node.about.work.task
                && !without_seed(other).iter().any(differs)
        };
        let step = |node: &NodeRecord| {
            let mut params = node.about.work.params.clone();
            params.as_object_mut().map(|table| table.remove("samples"));
            digest::canonical(&json!([
                without_member(&node.about.stage),
                node.about.work.kind,
                node.about.work.version,
                params
            ]))
        };
        let steps: BTreeSet<String> = self.manifest.nodes.iter().filter(is_beside).map(step).collect();
        Digest::of_json(&json!(steps))
    }
}
