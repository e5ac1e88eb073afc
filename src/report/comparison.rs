//! The comparison of two runs: parameters, metrics with their uncertainty, outputs.

use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;
use serde_json::Value;

use super::{
    outcomes::outcomes,
    point::without_seed,
    series::{Series, pooled},
};
use crate::{
    node_name::without_member,
    num::stats::{self, Difference, Summary},
    pipeline::Member,
    run::{
        changes::{self, Change},
        manifest::Manifest,
        node::NodeRecord,
    },
    stage::Kind,
    store::ResultStore,
};

/// The differences between two runs.
#[derive(Debug, Serialize)]
pub struct Comparison {
    /// Parameters that differ.
    pub parameters: Vec<Changed>,
    /// Stages of the first run alone.
    pub only_before: Vec<String>,
    /// Stages of the second run alone.
    pub only_after: Vec<String>,
    /// The metric of every stage that measured models in both runs.
    #[serde(rename = "figures")]
    pub metrics: Vec<Metric>,
    /// Nodes by their outputs.
    pub outputs: Outputs,
}

/// A parameter of a stage that differs.
#[derive(Debug, Serialize)]
pub struct Changed {
    /// The pipeline and the stage, such as `toy/learn`.
    pub stage: String,
    /// The old value and the new one.
    pub change: Change,
    /// The rounds in which it differs.
    pub rounds: Vec<u32>,
}

/// The metric of one stage in both runs.
#[derive(Debug, Serialize)]
pub struct Metric {
    /// The pipeline.
    pub pipeline: String,
    /// The stage.
    pub stage: String,
    /// Statistics of the first run.
    pub before: Summary,
    /// Statistics of the second run.
    pub after: Summary,
    /// The second mean minus the first.
    pub difference: Option<Difference>,
}

/// Nodes that both runs have, by their outputs.
#[derive(Debug, Default, Serialize)]
pub struct Outputs {
    /// The number of nodes with equal outputs.
    pub equal: usize,
    /// Names of the nodes whose outputs differ.
    pub differ: Vec<String>,
    /// The number of nodes that are not finished in both runs.
    pub unfinished: usize,
}

/// Compares two runs by a metric.
///
/// # Errors
/// The store cannot be read.
pub fn compare(
    runs: [Manifest; 2],
    metric: &str,
    store: &dyn ResultStore,
    kinds: &[Kind],
) -> anyhow::Result<Comparison> {
    let [mut before, mut after] = runs;
    // A member of a suite is compared with the same member, or with the pipeline where that ran alone.
    let is_suite = |manifest: &Manifest| manifest.members.iter().any(|member| !member.name.is_empty());
    if !(is_suite(&before) && is_suite(&after)) {
        [&mut before, &mut after].into_iter().flat_map(|it| &mut it.members).for_each(|member| member.name.clear());
    }
    let [old, new] = [stages(&before), stages(&after)];
    Ok(Comparison {
        parameters: parameters(&before, &after),
        only_before: old.difference(&new).cloned().collect(),
        only_after: new.difference(&old).cloned().collect(),
        metrics: metrics([&before, &after], metric, store, kinds)?,
        outputs: outputs(&before, &after),
    })
}

/// The name of a pipeline in its suite, or else its own name.
fn name_of(member: &Member) -> &String {
    if member.name.is_empty() { &member.pipeline } else { &member.name }
}

/// The place of a node in its pipeline, for any seed.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
struct Place {
    stage: String,
    round: Option<u32>,
    point: Vec<(String, String)>,
}

impl Place {
    fn of(manifest: &Manifest, node: &NodeRecord) -> Self {
        let stage = format!("{}/{}", name_of(&manifest.members[node.about.member]), without_member(&node.about.stage));
        Self { stage, round: node.about.round, point: without_seed(node) }
    }
}

fn stages(manifest: &Manifest) -> BTreeSet<String> {
    manifest.nodes.iter().map(|node| Place::of(manifest, node).stage).collect()
}

/// Parameters that differ at places of both runs.
fn parameters(before: &Manifest, after: &Manifest) -> Vec<Changed> {
    let known: BTreeMap<Place, &NodeRecord> = before.nodes.iter().map(|node| (Place::of(before, node), node)).collect();
    let mut seen = BTreeSet::new();
    let mut changed: Vec<Changed> = Vec::new();
    for node in &after.nodes {
        let place = Place::of(after, node);
        let Some(old) = known.get(&place).filter(|_| seen.insert(place.clone())) else { continue };
        for change in changes::between(&own(before, old), &own(after, node)) {
            let at = changed.iter().position(|it| it.stage == place.stage && it.change == change);
            let at = at.unwrap_or_else(|| {
                changed.push(Changed { stage: place.stage.clone(), change, rounds: Vec::new() });
                changed.len() - 1
            });
            let rounds = &mut changed[at].rounds;
            rounds.extend(place.round);
            rounds.sort_unstable();
            rounds.dedup();
        }
    }
    changed
}

/// A node's key without its inputs and its seed.
fn own(manifest: &Manifest, node: &NodeRecord) -> Value {
    let mut key = manifest.key_of(node);
    key["inputs"] = Value::Null;
    key["stream"]["seed"] = Value::Null;
    key
}

/// The metric of what both runs measured in their last rounds. Where each run has one series, of the same task, the two
/// are compared whatever their names.
fn metrics(
    manifests: [&Manifest; 2],
    metric: &str,
    store: &dyn ResultStore,
    kinds: &[Kind],
) -> anyhow::Result<Vec<Metric>> {
    let of = |manifest: &Manifest| {
        let finals = outcomes(manifest, kinds).into_iter().filter(|outcome| outcome.is_last).collect();
        pooled(finals, metric, true, store)
    };
    let [before, mut after] = [of(manifests[0])?, of(manifests[1])?];
    let are_alone = before.len() == 1 && after.len() == 1 && before[0].first().task == after[0].first().task;
    let mut metrics = Vec::new();
    for old in before {
        let Some(at) = after.iter().position(|new| are_alone || is_same(&old, new)) else { continue };
        metrics.push(pair(old, after.remove(at)));
    }
    Ok(metrics)
}

fn is_same(one: &Series, other: &Series) -> bool {
    let (one, other) = (one.first(), other.first());
    (name_of(&one.member), &one.stage, &one.task, &one.point)
        == (name_of(&other.member), &other.stage, &other.task, &other.point)
}

fn pair(old: Series, new: Series) -> Metric {
    let both = |one: &String, other: &String| {
        if one == other { one.clone() } else { format!("{one} -> {other}") }
    };
    let (first, second) = (old.first(), new.first());
    Metric {
        pipeline: both(name_of(&first.member), name_of(&second.member)),
        stage: both(&first.stage, &second.stage),
        difference: difference(&old, &new),
        before: old.summary(),
        after: new.summary(),
    }
}

/// The difference over pairs of models where seeds are common, else between the two sets of models.
fn difference(before: &Series, after: &Series) -> Option<Difference> {
    let by_seed = |series: &Series| -> BTreeMap<u64, f64> {
        series.outcomes.iter().map(|outcome| outcome.seed).zip(series.values.iter().copied()).collect()
    };
    let (old, new) = (by_seed(before), by_seed(after));
    let pairs: Vec<(f64, f64)> = old.iter().filter_map(|(seed, value)| Some((*value, *new.get(seed)?))).collect();
    stats::paired(&pairs).or_else(|| stats::unpaired(&before.values, &after.values))
}

fn outputs(before: &Manifest, after: &Manifest) -> Outputs {
    let name = |manifest: &Manifest, node: &NodeRecord| {
        (
            name_of(&manifest.members[node.about.member]).clone(),
            without_member(&node.about.name).to_owned(),
            node.about.work.stream.seed,
        )
    };
    let known: BTreeMap<_, _> = before.nodes.iter().map(|node| (name(before, node), node.outcome.output)).collect();
    let mut outputs = Outputs::default();
    for node in &after.nodes {
        match (known.get(&name(after, node)), node.outcome.output) {
            (Some(Some(old)), Some(new)) if *old == new => outputs.equal += 1,
            (Some(Some(_)), Some(_)) => outputs.differ.push(node.about.name.clone()),
            (Some(_), _) => outputs.unfinished += 1,
            (None, _) => {}
        }
    }
    outputs
}
