//! `carl-pipe compare`: what differs between two runs: parameters, metrics with their uncertainty, outputs.

use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;
use serde_json::{Value, json};

use super::{
    Global,
    exit::{Error, Exit},
    out::{self, Paint},
    table::{
        render::{mean, number},
        series::{Series, pooled},
    },
};
use crate::{
    node_name::without_member,
    num::stats::{self, Difference, Summary},
    pipeline::Member,
    report::outcomes::outcomes,
    run::{
        key::{self, Change},
        manifest::{Manifest, NodeRecord},
        runs,
    },
    stage::Kind,
    store::Store,
};

/// The arguments of `compare`.
#[derive(Debug, clap::Args)]
#[command(after_help = "The difference is the second run's mean less the first's. Its interval is a percentile \
bootstrap (95 %) over models: over pairs of models with the same seed where seeds are common, else over both runs' models \
on their own.

Examples:
  carl-pipe compare 20261122-0748 latest
  carl-pipe compare 20261122-0748 latest --metric map_quality --json")]
pub(crate) struct Args {
    /// The first run: `latest`, its id, or the beginning of its id.
    #[arg(value_name = "RUN")]
    before: String,
    /// The second run.
    #[arg(value_name = "RUN", default_value = "latest")]
    after: String,
    /// Which metric.
    #[arg(long, value_name = "NAME", default_value = "percent_goal")]
    metric: String,
    /// One JSON object.
    #[arg(long)]
    json: bool,
}

/// What differs between two runs.
#[derive(Debug, Serialize)]
struct Comparison {
    parameters: Vec<Changed>,
    only_before: Vec<String>,
    only_after: Vec<String>,
    #[serde(rename = "figures")]
    metrics: Vec<Metric>,
    outputs: Outputs,
}

/// A parameter of a stage that differs, and in which nodes.
#[derive(Debug, Serialize)]
struct Changed {
    stage: String,
    change: Change,
    rounds: Vec<u32>,
}

/// A metric of both runs.
#[derive(Debug, Serialize)]
struct Metric {
    pipeline: String,
    stage: String,
    before: Summary,
    after: Summary,
    difference: Option<Difference>,
}

/// Nodes of both runs by their outputs.
#[derive(Debug, Default, Serialize)]
struct Outputs {
    equal: usize,
    differ: Vec<String>,
    unfinished: usize,
}

/// Compares two runs.
pub(crate) fn compare(global: &Global, args: &Args, kinds: &[Kind]) -> Result<Exit, Error> {
    let store = global.store()?;
    let read = |run: &str| -> Result<Manifest, Error> {
        let folder = runs::find(&store.runs(), run).map_err(|error| Error::usage(error.to_string()))?;
        Ok(Manifest::read(&folder)?)
    };
    let (mut before, mut after) = (read(&args.before)?, read(&args.after)?);
    // A member of a suite is compared with the same member, or with the pipeline where that ran alone.
    if !(is_suite(&before) && is_suite(&after)) {
        [&mut before, &mut after].into_iter().flat_map(|it| &mut it.members).for_each(|member| member.name.clear());
    }
    let (parameters, only_before, only_after) = parameters(&before, &after);
    let metrics = metrics([&before, &after], &args.metric, &store, kinds)?;
    let outputs = outputs(&before, &after);
    let found = Comparison { parameters, only_before, only_after, metrics, outputs };
    if args.json {
        let mut object = json!(found);
        let head = [("version", json!(1)), ("before", json!(before.run)), ("after", json!(after.run))];
        head.into_iter().for_each(|(name, value)| object[name] = value);
        object["metric"] = json!(args.metric);
        out::line(&object.to_string());
    } else {
        print([&before, &after], &found, &args.metric, global.color.on_stdout());
    }
    Ok(Exit::Ok)
}

fn is_suite(manifest: &Manifest) -> bool {
    manifest.members.iter().any(|member| !member.name.is_empty())
}

/// A pipeline by its name in the suite, if it has one.
fn name_of(member: &Member) -> &String {
    if member.name.is_empty() { &member.pipeline } else { &member.name }
}

/// Where a node stands, whatever its seed: pipeline, stage, round, point.
type Place = (String, String, Option<u32>, Vec<(String, String)>);

fn place(manifest: &Manifest, node: &NodeRecord) -> Place {
    let point = node.point.iter().filter(|(axis, _)| axis != "seed").cloned().collect();
    (name_of(&manifest.members[node.member]).clone(), without_member(&node.stage).to_owned(), node.round, point)
}

/// Parameters that differ, and stages of one run alone.
fn parameters(before: &Manifest, after: &Manifest) -> (Vec<Changed>, Vec<String>, Vec<String>) {
    let known: BTreeMap<Place, &NodeRecord> = before.nodes.iter().map(|node| (place(before, node), node)).collect();
    let mut seen = BTreeSet::new();
    let mut changed: Vec<Changed> = Vec::new();
    for node in &after.nodes {
        let place = place(after, node);
        let Some(old) = known.get(&place).filter(|_| seen.insert(place.clone())) else { continue };
        for change in key::changes(&own(before, old), &own(after, node)) {
            let stage = format!("{}/{}", place.0, place.1);
            let at = changed.iter().position(|it| it.stage == stage && it.change == change).unwrap_or_else(|| {
                changed.push(Changed { stage, change, rounds: Vec::new() });
                changed.len() - 1
            });
            changed[at].rounds.extend(place.2);
            changed[at].rounds.sort_unstable();
            changed[at].rounds.dedup();
        }
    }
    let stages = |manifest: &Manifest| -> BTreeSet<String> {
        manifest.nodes.iter().map(|node| place(manifest, node)).map(|it| format!("{}/{}", it.0, it.1)).collect()
    };
    let (old, new) = (stages(before), stages(after));
    let only = |one: &BTreeSet<String>, other: &BTreeSet<String>| one.difference(other).cloned().collect();
    (changed, only(&old, &new), only(&new, &old))
}

/// A node's key without its inputs and its seed.
fn own(manifest: &Manifest, node: &NodeRecord) -> Value {
    let mut key = manifest.key_of(node);
    key["inputs"] = Value::Null;
    key["stream"]["seed"] = Value::Null;
    key
}

/// The metrics of what both runs evaluated; two that stand alone are compared whatever they are called.
fn metrics(manifests: [&Manifest; 2], metric: &str, store: &Store, kinds: &[Kind]) -> Result<Vec<Metric>, Error> {
    let of = |manifest: &Manifest| {
        let finals = outcomes(manifest, kinds).into_iter().filter(|outcome| outcome.is_last).collect();
        pooled(finals, metric, true, store)
    };
    let [before, mut after] = [of(manifests[0])?, of(manifests[1])?];
    let is_same = |one: &Series, other: &Series| {
        let (one, other) = (one.first(), other.first());
        (name_of(&one.member), &one.stage, &one.task, &one.point)
            == (name_of(&other.member), &other.stage, &other.task, &other.point)
    };
    let are_alone = before.len() == 1 && after.len() == 1 && before[0].first().task == after[0].first().task;
    let mut metrics = Vec::new();
    for old in before {
        let Some(at) = after.iter().position(|new| are_alone || is_same(&old, new)) else { continue };
        let new = after.remove(at);
        let [pipelines, stages] =
            [[name_of(&old.first().member), name_of(&new.first().member)], [&old.first().stage, &new.first().stage]];
        let names = |[one, other]: [&String; 2]| {
            if one == other { one.clone() } else { format!("{one} -> {other}") }
        };
        metrics.push(Metric {
            pipeline: names(pipelines),
            stage: names(stages),
            difference: difference(&old, &new),
            before: old.summary,
            after: new.summary,
        });
    }
    Ok(metrics)
}

/// Over pairs of models where seeds are common, else over both sides on their own.
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
        (name_of(&manifest.members[node.member]).clone(), without_member(&node.name).to_owned(), node.stream.seed)
    };
    let known: BTreeMap<_, _> = before.nodes.iter().map(|node| (name(before, node), node.output)).collect();
    let mut outputs = Outputs::default();
    for node in &after.nodes {
        match (known.get(&name(after, node)), node.output) {
            (Some(Some(old)), Some(new)) if *old == new => outputs.equal += 1,
            (Some(Some(_)), Some(_)) => outputs.differ.push(node.name.clone()),
            (Some(_), _) => outputs.unfinished += 1,
            (None, _) => {}
        }
    }
    outputs
}

fn print(manifests: [&Manifest; 2], found: &Comparison, metric: &str, paint: Paint) {
    for (word, manifest) in ["before", "after"].into_iter().zip(manifests) {
        let commit = manifest.commit.as_ref().map_or_else(String::new, |commit| format!(", commit {commit}"));
        out::line(&format!("{word:6} {} {}{commit}", manifest.run, paint.bold(&manifest.pipeline)));
    }
    let mut rows = Vec::new();
    for Changed { stage, change, rounds } in &found.parameters {
        rows.push(vec![format!("  {stage}{}", shown(rounds)), change.to_string()]);
    }
    rows.extend(found.only_before.iter().map(|stage| vec![format!("  {stage}"), "only before".to_owned()]));
    rows.extend(found.only_after.iter().map(|stage| vec![format!("  {stage}"), "only after".to_owned()]));
    out::line(&format!("\n{}", paint.bold(if rows.is_empty() { "parameters are equal" } else { "parameters" })));
    out::print(&out::table(&rows));
    let rows: Vec<Vec<String>> = found.metrics.iter().map(|metric| metric_row(metric, paint)).collect();
    if rows.is_empty() {
        out::line(&format!("\n{}", paint.bold(&format!("{metric}: nothing that both runs evaluated"))));
    } else {
        out::line(&format!("\n{}", paint.bold(&format!("{metric}: mean ± standard error (models)"))));
        out::print(&out::table(&rows));
    }
    let Outputs { equal, differ, unfinished } = &found.outputs;
    let first = differ.first().map_or_else(String::new, |node| format!(", first {node}"));
    let left = if *unfinished > 0 { format!(", {unfinished} not finished in both") } else { String::new() };
    out::line(&format!("\n{} {equal} equal, {} differ{first}{left}", paint.bold("outputs:"), differ.len()));
}

fn metric_row(metric: &Metric, paint: Paint) -> Vec<String> {
    let difference = metric.difference.as_ref().map_or_else(String::new, |it| {
        let interval = match it.ci95 {
            Some([low, high]) => {
                let text = format!(", 95 % interval {} to {}", signed(low), signed(high));
                // Zero outside of the interval is what one looks for.
                if low > 0.0 || high < 0.0 { paint.bold(&text) } else { text }
            }
            None => String::new(),
        };
        let pairs = match it.pairs {
            Some(1) => ", 1 pair of models".to_owned(),
            Some(pairs) => format!(", {pairs} pairs of models"),
            None => ", no seed in common".to_owned(),
        };
        format!("{}{interval}{pairs}", signed(it.mean))
    });
    let name = format!("  {}/{}", metric.pipeline, metric.stage);
    vec![name, mean(&metric.before), "->".to_owned(), mean(&metric.after), difference]
}

fn signed(value: f64) -> String {
    if value > 0.0 { format!("+{}", number(value)) } else { number(value) }
}

/// `@3`, `@1 to 8`, or nothing.
fn shown(rounds: &[u32]) -> String {
    match rounds {
        [] => String::new(),
        [one] => format!("@{one}"),
        [first, .., last] => format!("@{first} to {last}"),
    }
}
