//! The lineage of a result: the nodes that it was made from, their samples, and digests of their recipe.

use std::{
    cell::{OnceCell, RefCell},
    collections::{BTreeMap, BTreeSet},
};

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

/// The member, the point of the matrix and the round of a node.
type Place<'a> = (usize, &'a [(String, String)], Option<u32>);

/// The member, the task as text and the point that nodes of one family share.
type FamilyOf = (usize, String, Vec<(String, String)>);

/// The nodes of a run, by name and by place. What is asked of many nodes is computed once.
pub(super) struct Lineage<'a> {
    manifest: &'a Manifest,
    kinds: &'a [Kind],
    by_name: BTreeMap<&'a str, usize>,
    by_place: BTreeMap<Place<'a>, Vec<&'a NodeRecord>>,
    /// The step of each node in a recipe.
    steps: Vec<OnceCell<String>>,
    families: RefCell<BTreeMap<FamilyOf, Digest>>,
}

impl<'a> Lineage<'a> {
    pub(super) fn new(manifest: &'a Manifest, kinds: &'a [Kind]) -> Self {
        let by_name = manifest.nodes.iter().enumerate().map(|(id, node)| (node.about.name.as_str(), id)).collect();
        let mut by_place: BTreeMap<_, Vec<_>> = BTreeMap::new();
        for node in &manifest.nodes {
            by_place.entry(place(node)).or_default().push(node);
        }
        let steps = vec![OnceCell::new(); manifest.nodes.len()];
        Self { manifest, kinds, by_name, by_place, steps, families: RefCell::default() }
    }

    /// The nodes in the round of a node at its point, and itself.
    pub(super) fn beside(&self, node: &'a NodeRecord) -> impl Iterator<Item = &'a NodeRecord> {
        self.by_place.get(&place(node)).into_iter().flatten().copied()
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

    /// The number of transitions made upstream. Nodes with equal keys count once, since they were sampled once. Kinds that make
    /// no transitions but sample the task report the metric `samples`.
    pub(super) fn samples(&self, upstream: &BTreeSet<usize>) -> u64 {
        let makes =
            |node: &NodeRecord| node.about.work.kind_among(self.kinds).is_some_and(|kind| kind.gives(TRANSITIONS));
        let of = |node: &NodeRecord| match node.outcome.metrics.get("samples") {
            Some(&samples) => Some(samples as u64),
            None => node.about.work.params["samples"].as_u64().filter(|_| makes(node)),
        };
        let mut counted = BTreeSet::new();
        let nodes = upstream.iter().map(|&id| &self.manifest.nodes[id]);
        let data = nodes.filter_map(|node| Some((node, of(node)?)));
        data.filter(|(node, _)| node.outcome.key.is_none_or(|key| counted.insert(key)))
            .map(|(_, samples)| samples)
            .sum()
    }

    /// A digest of everything upstream except seeds.
    pub(super) fn recipe(&self, upstream: &BTreeSet<usize>) -> Digest {
        let step = |&id: &usize| self.steps[id].get_or_init(|| self.step(&self.manifest.nodes[id]));
        let steps: BTreeSet<&String> = upstream.iter().map(step).collect();
        Digest::of_json(&json!(steps))
    }

    /// A node without its seed, as text.
    fn step(&self, node: &NodeRecord) -> String {
        let source = |name: &String| {
            let node = self.by_name.get(name.as_str()).map(|&id| &self.manifest.nodes[id]);
            node.map(|node| json!([without_member(&node.about.stage), node.about.round]))
        };
        let inputs: BTreeMap<&String, Vec<_>> =
            node.about.inputs.iter().map(|(port, names)| (port, names.iter().map(source).collect())).collect();
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
    }

    /// A digest of the pipeline at a node's point, except rounds, seeds and numbers of samples.
    pub(super) fn family(&self, node: &NodeRecord) -> Digest {
        let own = without_samples(without_seed(node));
        let of = (node.about.member, digest::canonical(&json!(node.about.work.task.in_key())), own);
        if let Some(&known) = self.families.borrow().get(&of) {
            return known;
        }
        let family = self.new_family(node, &of.2);
        self.families.borrow_mut().insert(of, family);
        family
    }

    fn new_family(&self, node: &NodeRecord, own: &[(String, String)]) -> Digest {
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

fn place(node: &NodeRecord) -> Place<'_> {
    (node.about.member, &node.about.point, node.about.round)
}
