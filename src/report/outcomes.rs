//! What runs measured: every evaluation with its seed, its samples and the recipe that led to it, read off manifests.
//!
//! Two outcomes with equal recipes differ by their seed alone, so that they may be pooled whatever run they are from.

use std::collections::{BTreeMap, BTreeSet};

use serde_json::{Value, json};

use crate::{
    digest::Digest,
    env::{Protocol, Task},
    node_name::without_member,
    pipeline::Member,
    run::{
        events::NodeState,
        manifest::{Manifest, NodeRecord},
    },
    stage::{Kind, Preset, PresetOf},
    store::Store,
};

/// What the number of samples is counted by.
const TRANSITIONS: &str = "transitions";

/// One result of one model: what a stage whose kind declares a headline metric measured.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// The metric that it is judged by (`Stage::HEADLINE`).
    pub headline: &'static str,
    /// The run.
    pub run: String,
    /// The commit of the program that ran it.
    pub commit: Option<String>,
    /// The pipeline.
    pub member: Member,
    /// The node's name.
    pub node: String,
    /// The stage, without the member of a suite.
    pub stage: String,
    /// The seed.
    pub seed: u64,
    /// The other axes of the matrix that reach it.
    pub point: Vec<(String, String)>,
    /// The round.
    pub round: Option<u32>,
    /// Whether it is of the last round.
    pub is_last: bool,
    /// The task.
    pub task: Task,
    /// Mean %-goal of the best possible controller, where it was measured under the protocol of this evaluation.
    pub ceiling: Option<f64>,
    /// Transitions that what is evaluated was trained on.
    pub samples: u64,
    /// Names everything that led to it but the seed.
    pub recipe: Digest,
    /// Names what all rounds and numbers of samples of one curve share.
    pub family: Digest,
    /// The digest of its key.
    pub key: Option<Digest>,
    /// The content digest of the evaluation.
    pub output: Option<Digest>,
    /// Its metrics, and those of other stages of its round at its point.
    pub metrics: BTreeMap<String, f64>,
}

/// Whether a node has a result.
pub fn is_done(node: &NodeRecord) -> bool {
    matches!(node.state, NodeState::Ran | NodeState::Cached)
}

/// Every finished result of a run, in the order of its nodes.
pub fn outcomes(manifest: &Manifest, kinds: &[Kind]) -> Vec<Outcome> {
    let reader = Reader::new(manifest, kinds);
    let done = manifest.nodes.iter().enumerate().filter(|(_, node)| is_done(node));
    done.filter_map(|(id, node)| Some(reader.outcome(id, reader.kind(node)?.headline?))).collect()
}

struct Reader<'a> {
    manifest: &'a Manifest,
    kinds: &'a [Kind],
    by_name: BTreeMap<&'a str, usize>,
}

impl<'a> Reader<'a> {
    fn new(manifest: &'a Manifest, kinds: &'a [Kind]) -> Self {
        let by_name = manifest.nodes.iter().enumerate().map(|(id, node)| (node.name.as_str(), id)).collect();
        Self { manifest, kinds, by_name }
    }

    fn kind(&self, node: &NodeRecord) -> Option<&'a Kind> {
        self.kinds.iter().find(|kind| kind.name == node.kind)
    }

    fn gives(&self, id: usize, artifact: &str) -> bool {
        self.kind(&self.manifest.nodes[id]).is_some_and(|kind| kind.output == artifact)
    }

    fn outcome(&self, id: usize, headline: &'static str) -> Outcome {
        let node = &self.manifest.nodes[id];
        let upstream = self.upstream(id);
        Outcome {
            headline,
            run: self.manifest.run.clone(),
            commit: self.manifest.commit.clone(),
            member: self.manifest.members[node.member].clone(),
            node: node.name.clone(),
            stage: without_member(&node.stage).to_owned(),
            seed: node.stream.seed,
            point: without_seed(node),
            round: node.round,
            is_last: node.is_last,
            task: node.task.clone(),
            ceiling: self.ceiling(node),
            samples: self.samples(&upstream),
            recipe: self.recipe(&upstream),
            family: self.family(node),
            key: node.key,
            output: node.output,
            metrics: self.metrics(node),
        }
    }

    /// A node and all that it was made from.
    fn upstream(&self, id: usize) -> BTreeSet<usize> {
        let (mut found, mut open) = (BTreeSet::from([id]), vec![id]);
        while let Some(id) = open.pop() {
            for source in self.manifest.nodes[id].inputs.values().flatten() {
                if let Some(&source) = self.by_name.get(source.as_str())
                    && found.insert(source)
                {
                    open.push(source);
                }
            }
        }
        found
    }

    /// Transitions made upstream; what two nodes share by an equal key was sampled once.
    fn samples(&self, upstream: &BTreeSet<usize>) -> u64 {
        let mut counted = BTreeSet::new();
        let data = upstream.iter().filter(|&&id| self.gives(id, TRANSITIONS)).map(|&id| &self.manifest.nodes[id]);
        data.filter(|node| node.key.is_none_or(|key| counted.insert(key)))
            .filter_map(|node| node.params["samples"].as_u64())
            .sum()
    }

    fn recipe(&self, upstream: &BTreeSet<usize>) -> Digest {
        let place = |name: &String| {
            let node = self.by_name.get(name.as_str()).map(|&id| &self.manifest.nodes[id]);
            node.map(|node| json!([without_member(&node.stage), node.round]))
        };
        let steps: BTreeSet<String> = upstream
            .iter()
            .map(|&id| &self.manifest.nodes[id])
            .map(|node| {
                let inputs: BTreeMap<&String, Vec<_>> =
                    node.inputs.iter().map(|(port, names)| (port, names.iter().map(place).collect())).collect();
                let step = json!([
                    without_member(&node.stage),
                    node.round,
                    node.kind,
                    node.version,
                    node.params,
                    node.task,
                    node.stream.stream,
                    inputs
                ]);
                crate::digest::canonical(&step)
            })
            .collect();
        Digest::of_json(&json!(steps))
    }

    /// What the nodes of one pipeline at one point are, but for rounds, seeds and numbers of samples.
    fn family(&self, node: &NodeRecord) -> Digest {
        let own = without_samples(without_seed(node));
        let is_beside = |other: &&NodeRecord| {
            let differs = |(axis, value): &(String, String)| own.iter().any(|(mine, it)| mine == axis && it != value);
            other.member == node.member && other.task == node.task && !without_seed(other).iter().any(differs)
        };
        let steps: BTreeSet<String> = self
            .manifest
            .nodes
            .iter()
            .filter(is_beside)
            .map(|node| {
                let mut params = node.params.clone();
                params.as_object_mut().map(|table| table.remove("samples"));
                crate::digest::canonical(&json!([without_member(&node.stage), node.kind, node.version, params]))
            })
            .collect();
        Digest::of_json(&json!(steps))
    }

    /// A protocol is what an evaluation can set but who acts, the rule outside of the policy and how often it is tried.
    fn ceiling(&self, node: &NodeRecord) -> Option<f64> {
        const FREE: [&str; 4] = ["controller", "episodes", "start", "unstick"];
        let (kind, params) = (self.kind(node)?, node.params.as_object()?);
        let own = (kind.preset)(&PresetOf { preset: Preset::Recipe, task: &node.task, given: params });
        let is_own = params.iter().all(|(name, value)| FREE.contains(&name.as_str()) || own[name] == *value);
        let radius = params.get("radius")?.as_f64()?;
        let start =
            params.get("start").and_then(|start| serde_json::from_value(start.clone()).ok()).unwrap_or_default();
        node.task.ceiling(Protocol { radius, start }).filter(|_| is_own)
    }

    /// The metrics of an evaluation, and those of other stages of its round at its point.
    fn metrics(&self, node: &NodeRecord) -> BTreeMap<String, f64> {
        let mut metrics = node.metrics.clone();
        let is_beside = |other: &&NodeRecord| {
            (other.member, &other.point, other.round) == (node.member, &node.point, node.round)
                && is_done(other)
                && other.name != node.name
        };
        for other in self.manifest.nodes.iter().filter(is_beside) {
            for (name, value) in &other.metrics {
                metrics.entry(name.clone()).or_insert(*value);
            }
        }
        metrics
    }
}

fn without_seed(node: &NodeRecord) -> Vec<(String, String)> {
    node.point.iter().filter(|(axis, _)| axis != "seed").cloned().collect()
}

/// A point without the axes that only say how many samples there are.
pub fn without_samples(point: Vec<(String, String)>) -> Vec<(String, String)> {
    point.into_iter().filter(|(axis, _)| !axis.ends_with(".samples")).collect()
}

impl Outcome {
    /// A metric by its name: one that a stage reported, or a number in the evaluation itself.
    ///
    /// # Errors
    /// What the system says of the store.
    pub fn metric(&self, name: &str, store: &Store) -> anyhow::Result<Option<f64>> {
        if name == "samples" {
            return Ok(Some(self.samples as f64));
        }
        if let Some(value) = self.metrics.get(name) {
            return Ok(Some(*value));
        }
        let entry = self.key.map_or(Ok(None), |key| store.entry(key))?;
        let Some(entry) = entry.filter(|entry| Some(entry.output) == self.output) else { return Ok(None) };
        let Ok(files) = store.load(&entry)? else { return Ok(None) };
        let texts = files.iter().filter(|(name, _)| name.ends_with(".json")).map(|(_, bytes)| bytes);
        let values = texts.filter_map(|bytes| serde_json::from_slice::<Value>(bytes).ok());
        Ok(values.filter_map(|value| value.get(name)?.as_f64()).next())
    }

    /// The task in a word, with the options that are not its own defaults.
    pub fn task_name(&self) -> String {
        let env = self.task.env.word();
        let (own, defaults) = (json!(self.task), serde_json::from_value::<Task>(json!({ "env": env })).ok());
        let defaults = json!(defaults);
        let options = own.as_object().into_iter().flatten().filter(|(name, value)| defaults[name.as_str()] != **value);
        let options: Vec<String> = options.map(|(name, value)| format!(", {name} {value}")).collect();
        format!("{env}{}", options.concat())
    }
}
