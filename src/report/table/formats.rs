//! A table for programs: CSV with one line for each series, or one JSON object.

use serde_json::{Value, json};

use super::{
    About,
    grid::{Cell, Grid, field},
};
use crate::{
    num::stats::RESAMPLES,
    report::{outcomes::Outcome, series::SampleRange},
    store::ResultStore,
};

/// One line for each series, with every statistic, below a header.
///
/// # Errors
/// The store cannot be read.
pub fn csv(grid: &Grid, about: About<'_>, store: &dyn ResultStore) -> anyhow::Result<String> {
    let objects = objects(grid, about, store)?;
    let Some(Value::Object(first)) = objects.first() else { return Ok(String::new()) };
    let names: Vec<&str> = first.keys().map(String::as_str).filter(|name| *name != "models").collect();
    let mut text = names.join(",") + "\n";
    for object in &objects {
        text += &names.iter().map(|name| quoted(&object[*name])).collect::<Vec<_>>().join(",");
        text.push('\n');
    }
    Ok(text)
}

/// A value of CSV; in quotes where it holds a comma, a quote or a line break.
fn quoted(value: &Value) -> String {
    let text = match value {
        Value::Null => String::new(),
        Value::String(text) => text.clone(),
        other => other.to_string(),
    };
    if text.contains([',', '"', '\n', '\r']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text }
}

/// One JSON object, with every statistic and every model of each series.
///
/// # Errors
/// The store cannot be read.
pub fn json(grid: &Grid, about: About<'_>, store: &dyn ResultStore) -> anyhow::Result<String> {
    let cells = objects(grid, about, store)?;
    let object = json!({
        "version": 1, "metric": about.metric, "rows": about.rows, "cols": about.cols, "resamples": RESAMPLES,
        "cells": cells,
    });
    Ok(format!("{object}\n"))
}

fn objects(grid: &Grid, about: About<'_>, store: &dyn ResultStore) -> anyhow::Result<Vec<Value>> {
    let mut objects = Vec::new();
    for cell in &grid.cells {
        let series = &cell.series;
        let mut object = statistics(grid, cell, about.metric);
        if about.is_percent_goal() {
            let mean_of = |metric| series.mean_of(metric, store);
            object["policy_alone"] = json!(mean_of("policy_alone")?);
            object["percent_goal_t"] = json!(mean_of("percent_goal_t")?);
            object["ceiling"] = json!(series.ceiling());
            object["share_of_ceiling"] = json!(series.ceiling().map(|it| 100.0 * series.estimate().mean / it));
            object["paper"] = json!(series.label("paper"));
            object["additions"] = json!(series.label("additions"));
        }
        object["models"] = series.outcomes.iter().zip(&series.values).map(|(it, value)| model(it, *value)).collect();
        objects.push(object);
    }
    Ok(objects)
}

fn statistics(grid: &Grid, cell: &Cell, metric: &str) -> Value {
    let series = &cell.series;
    let (it, summary) = (series.first(), series.summary());
    let SampleRange { least, most } = series.samples();
    json!({
        "row": grid.rows[cell.row], "col": grid.cols[cell.col], "metric": metric,
        "task": it.task_name(), "algorithm": field(it, "algorithm"), "pipeline": it.member.pipeline,
        "file": it.member.file, "stage": it.stage, "n": summary.n, "mean": summary.mean,
        "standard_error": summary.standard_error, "ci95_low": summary.ci95.map(|[low, _]| low),
        "ci95_high": summary.ci95.map(|[_, high]| high), "best": summary.best, "worst": summary.worst,
        "top_five": summary.top_five.mean, "top_five_of": summary.top_five.of,
        "worst_five": summary.worst_five.mean, "worst_five_of": summary.worst_five.of,
        "samples": least, "samples_most": most, "seeds": series.seeds(), "commit": series.commits(),
    })
}

fn model(outcome: &Outcome, value: f64) -> Value {
    json!({
        "seed": outcome.seed, "value": value, "samples": outcome.samples, "run": outcome.run,
        "node": outcome.node, "output": outcome.output,
    })
}
