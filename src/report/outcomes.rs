//! Outcomes: every result of a model, with its seed, its number of samples and the recipe that led to it, read off
//! manifests.

use std::collections::BTreeMap;

use serde_json::{Value, json};

use super::{lineage::Lineage, point::without_seed};
use crate::{
    digest::Digest,
    env::{Protocol, Task},
    node_name::without_member,
    pipeline::Member,
    run::{events::NodeState, manifest::Manifest, node::NodeRecord},
    stage::{Kind, Preset, PresetOf},
    store::{self, ResultStore},
};

/// One result of one model: what a stage whose kind declares a headline metric measured.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// The metric that the model is judged by (`Stage::HEADLINE`).
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
    /// The values of the matrix's other axes.
    pub point: Vec<(String, String)>,
    /// The round; `None` outside of a loop.
    pub round: Option<u32>,
    /// Whether it belongs to the last round.
    pub is_last: bool,
    /// The task.
    pub task: Task,
    /// Mean %-goal of the best possible controller, where it was measured under the protocol of this evaluation.
    pub ceiling: Option<f64>,
    /// The number of transitions that the model was trained on.
    pub samples: u64,
    /// A digest of everything that led to it except the seed. Outcomes with equal recipes may be pooled.
    pub recipe: Digest,
    /// A digest of what all rounds and numbers of samples of one curve share; [`final_outcomes`] leaves it `None`.
    pub family: Option<Digest>,
    /// The digest of the node's key.
    pub key: Option<Digest>,
    /// The content digest of the node's output.
    pub output: Option<Digest>,
    /// Its metrics, and those of other stages in its round at its point.
    pub metrics: BTreeMap<String, f64>,
}

/// Whether a node has a result.
pub fn is_done(node: &NodeRecord) -> bool {
    matches!(node.outcome.state, NodeState::Ran | NodeState::Cached)
}

/// Every finished result of a run, in the order of its nodes.
pub fn outcomes(manifest: &Manifest, kinds: &[Kind]) -> Vec<Outcome> {
    let lineage = Lineage::new(manifest, kinds);
    let with_family = |(node, outcome)| Outcome { family: Some(lineage.family(node)), ..outcome };
    outcomes_of(manifest, kinds, &lineage, is_done).map(with_family).collect()
}

/// Every finished result of the last rounds of a run, in the order of its nodes.
pub fn final_outcomes(manifest: &Manifest, kinds: &[Kind]) -> Vec<Outcome> {
    let is_wanted = |node: &NodeRecord| node.about.is_last && is_done(node);
    outcomes_of(manifest, kinds, &Lineage::new(manifest, kinds), is_wanted).map(|(_, outcome)| outcome).collect()
}

fn outcomes_of<'a>(
    manifest: &'a Manifest,
    kinds: &'a [Kind],
    lineage: &Lineage<'a>,
    is_wanted: fn(&NodeRecord) -> bool,
) -> impl Iterator<Item = (&'a NodeRecord, Outcome)> {
    let done = manifest.nodes.iter().enumerate().filter(move |(_, node)| is_wanted(node));
    done.filter_map(move |(id, node)| {
        let kind = node.about.work.kind_among(kinds)?;
        Some((node, outcome(manifest, lineage, id, kind, kind.headline?)))
    })
}

fn outcome<'a>(
    manifest: &'a Manifest,
    lineage: &Lineage<'a>,
    id: usize,
    kind: &Kind,
    headline: &'static str,
) -> Outcome {
    let node = &manifest.nodes[id];
    let upstream = lineage.upstream(id);
    Outcome {
        headline,
        run: manifest.run.clone(),
        commit: manifest.commit.clone(),
        member: manifest.members[node.about.member].clone(),
        node: node.about.name.clone(),
        stage: without_member(&node.about.stage).to_owned(),
        seed: node.about.work.stream.seed,
        point: without_seed(node),
        round: node.about.round,
        is_last: node.about.is_last,
        task: node.about.work.task.clone(),
        ceiling: ceiling(node, kind),
        samples: lineage.samples(&upstream),
        recipe: lineage.recipe(&upstream),
        family: None,
        key: node.outcome.key,
        output: node.outcome.output,
        metrics: metrics(lineage, node),
    }
}

/// The ceiling of an evaluation, where it was measured under exactly this protocol. The protocol consists of all
/// parameters but the free ones.
fn ceiling(node: &NodeRecord, kind: &Kind) -> Option<f64> {
    const FREE: [&str; 4] = ["controller", "episodes", "start", "unstick"];
    let params = node.about.work.params.as_object()?;
    let own = (kind.preset)(&PresetOf { preset: Preset::Recipe, task: &node.about.work.task, given: params });
    let is_own = params.iter().all(|(name, value)| FREE.contains(&name.as_str()) || own[name] == *value);
    let radius = params.get("radius")?.as_f64()?;
    let start = params.get("start").and_then(|start| serde_json::from_value(start.clone()).ok()).unwrap_or_default();
    node.about.work.task.ceiling(Protocol { radius, start }).filter(|_| is_own)
}

/// The metrics of a node, and those of other stages in its round at its point.
fn metrics<'a>(lineage: &Lineage<'a>, node: &'a NodeRecord) -> BTreeMap<String, f64> {
    let mut metrics = node.outcome.metrics.clone();
    let is_other = |other: &&NodeRecord| is_done(other) && other.about.name != node.about.name;
    for other in lineage.beside(node).filter(is_other) {
        for (name, value) in &other.outcome.metrics {
            metrics.entry(name.clone()).or_insert(*value);
        }
    }
    metrics
}

/// A point as text: `a.plus=1 b.steps=2`.
pub fn point_text(point: &[(String, String)]) -> String {
    point.iter().map(|(axis, value)| format!("{axis}={value}")).collect::<Vec<_>>().join(" ")
}

impl Outcome {
    /// A metric by its name: one that a stage reported, or a number in the result itself.
    ///
    /// # Errors
    /// The store cannot be read.
    pub fn metric(&self, name: &str, store: &dyn ResultStore) -> anyhow::Result<Option<f64>> {
        if name == "samples" {
            return Ok(Some(self.samples as f64));
        }
        if let Some(value) = self.metrics.get(name) {
            return Ok(Some(*value));
        }
        let entry = self.key.map_or(Ok(None), |key| store.entry(key))?;
        let Some(entry) = entry.filter(|entry| Some(entry.output) == self.output) else { return Ok(None) };
        let files = match store.load(&entry) {
            Ok(files) => files,
            Err(store::Error::Unusable { .. }) => return Ok(None),
            Err(error) => return Err(error.into()),
        };
        let texts = files.iter().filter(|(name, _)| name.ends_with(".json")).map(|(_, bytes)| bytes);
        let values = texts.filter_map(|bytes| serde_json::from_slice::<Value>(&bytes.bytes().ok()?).ok());
        Ok(values.filter_map(|value| value.get(name)?.as_f64()).next())
    }

    /// The task by name, with the options that differ from the task's defaults.
    pub fn task_name(&self) -> String {
        let env = self.task.name();
        if let Some((command, options)) = self.task.program_and_options() {
            let options: Vec<String> = options.iter().map(|(name, value)| format!(", {name} {value}")).collect();
            return format!("{}{}", command.join(" "), options.concat());
        }
        let (own, defaults) = (json!(self.task), serde_json::from_value::<Task>(json!({ "env": env })).ok());
        let defaults = json!(defaults);
        let options = own.as_object().into_iter().flatten().filter(|(name, value)| defaults[name.as_str()] != **value);
        let options: Vec<String> = options.map(|(name, value)| format!(", {name} {value}")).collect();
        format!("{env}{}", options.concat())
    }

    /// The paper's mean, from the pipeline's label `paper`: 68.0 for `68.0 ± 1.7`.
    pub fn paper(&self) -> Option<f64> {
        self.member.labels.get("paper")?.split_whitespace().next()?.parse().ok()
    }
}
