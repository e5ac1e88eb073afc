//! `carl-pipe compare`: shows what differs between two runs: parameters, metrics with their uncertainty, outputs.

use serde_json::{Value, json};

use super::{
    Global,
    exit::{Error, Exit},
    out,
};
use crate::{
    num::stats::Difference,
    report::{
        comparison::{Changed, Comparison, Metric, Outputs, compare as comparison},
        numbers::{mean, number},
        outcomes::outcomes,
    },
    stage::Kind,
};

/// The arguments of `compare`.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "The difference is the mean of the second run minus the mean of the first run. Its interval is a \
95 % percentile bootstrap over models. Models with the same seed are compared in pairs. Without common seeds, the models \
of each run are resampled on their own.

Examples:
  carl-pipe compare 20261122-0748 latest
  carl-pipe compare 20261122-0748 latest --metric map_quality --json"
)]
pub(crate) struct Args {
    /// The first run: `latest`, `latest~1`, a tag, a pipeline (its newest run), a run id, or the beginning of an id.
    #[arg(value_name = "RUN")]
    before: String,
    /// The second run.
    #[arg(value_name = "RUN", default_value = "latest")]
    after: String,
    /// The metric to compare; the headline of the second run if not given, such as percent_goal.
    #[arg(long, value_name = "NAME")]
    metric: Option<String>,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// The head of a run, for printing.
struct Head {
    run: String,
    pipeline: String,
    commit: Option<String>,
}

/// Compares two runs.
pub(crate) fn compare(global: &Global, args: &Args, kinds: &[Kind]) -> Result<Exit, Error> {
    let store = global.store_to_read()?;
    let manifests = [global.manifest(&args.before)?, global.manifest(&args.after)?];
    let heads = manifests.each_ref().map(|it| Head {
        run: it.run.clone(),
        pipeline: it.pipeline.clone(),
        commit: it.commit.clone(),
    });
    let headline = || outcomes(&manifests[1], kinds).first().map_or("percent_goal", |outcome| outcome.headline);
    let metric = args.metric.clone().unwrap_or_else(|| headline().to_owned());
    let found = comparison(manifests, &metric, &store, kinds)?;
    if args.json {
        out::json(&json_of(&heads, &found, &metric));
    } else {
        print(&heads, &found, &metric);
    }
    Ok(Exit::Ok)
}

fn json_of([before, after]: &[Head; 2], found: &Comparison, metric: &str) -> Value {
    let mut object = json!(found);
    let head = [("version", json!(1)), ("before", json!(before.run)), ("after", json!(after.run))];
    head.into_iter().for_each(|(name, value)| object[name] = value);
    object["metric"] = json!(metric);
    object
}

fn print(heads: &[Head; 2], found: &Comparison, metric: &str) {
    for (word, head) in ["before", "after"].into_iter().zip(heads) {
        let commit = head.commit.as_ref().map_or_else(String::new, |commit| format!(", commit {commit}"));
        out::line(&format!("{word:6} {} {}{commit}", head.run, out::bold(&head.pipeline)));
    }
    let mut rows = Vec::new();
    for Changed { stage, change, rounds } in &found.parameters {
        rows.push(vec![format!("  {stage}{}", at_rounds(rounds)), change.to_string()]);
    }
    rows.extend(found.only_before.iter().map(|stage| vec![format!("  {stage}"), "only before".to_owned()]));
    rows.extend(found.only_after.iter().map(|stage| vec![format!("  {stage}"), "only after".to_owned()]));
    out::line(&format!("\n{}", out::bold(if rows.is_empty() { "parameters are equal" } else { "parameters" })));
    out::print(&out::table(&rows));
    let rows: Vec<Vec<String>> = found.metrics.iter().map(metric_row).collect();
    let title = if rows.is_empty() { "no stage measured it in both runs" } else { "mean ± standard error (models)" };
    out::line(&format!("\n{}", out::bold(&format!("{metric}: {title}"))));
    out::print(&out::table(&rows));
    let Outputs { equal, differ, unfinished } = &found.outputs;
    let first = differ.first().map_or_else(String::new, |node| format!(", first {node}"));
    let left = if *unfinished > 0 { format!(", {unfinished} not finished in both") } else { String::new() };
    out::line(&format!("\n{} {equal} equal, {} differ{first}{left}", out::bold("outputs:"), differ.len()));
}

fn metric_row(metric: &Metric) -> Vec<String> {
    let difference = metric.difference.as_ref().map_or_else(String::new, difference);
    let name = format!("  {}/{}", metric.pipeline, metric.stage);
    vec![name, mean((&metric.before).into()), "->".to_owned(), mean((&metric.after).into()), difference]
}

fn difference(it: &Difference) -> String {
    let interval = it.ci95.map_or_else(String::new, |[low, high]| {
        let text = format!(", 95 % interval {} to {}", signed(low), signed(high));
        // Bold marks an interval without zero.
        if low > 0.0 || high < 0.0 { out::bold(&text) } else { text }
    });
    let pairs = match it.pairs {
        Some(1) => ", 1 pair of models".to_owned(),
        Some(pairs) => format!(", {pairs} pairs of models"),
        None => ", no seed in common".to_owned(),
    };
    format!("{}{interval}{pairs}", signed(it.mean))
}

fn signed(value: f64) -> String {
    if value > 0.0 { format!("+{}", number(value)) } else { number(value) }
}

/// `@3`, `@1 to 8`, or nothing.
fn at_rounds(rounds: &[u32]) -> String {
    match rounds {
        [] => String::new(),
        [one] => format!("@{one}"),
        [first, .., last] => format!("@{first} to {last}"),
    }
}
