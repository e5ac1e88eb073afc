//! A grid as text, Markdown, CSV or JSON.

use serde_json::{Value, json};

use super::{
    Format,
    grid::{Grid, field},
    series::Series,
};
use crate::{
    cli::{
        exit::Error,
        out::{self, Paint},
    },
    num::stats::Summary,
    store::Store,
};

/// What a table is about.
#[derive(Debug, Clone, Copy)]
pub(crate) struct About<'a> {
    pub(crate) metric: &'a str,
    pub(crate) rows: &'a str,
    pub(crate) cols: &'a str,
}

impl About<'_> {
    /// Whether metrics are shares of time at the goal, which have a ceiling and stand beside the paper's.
    fn is_goal(&self) -> bool {
        self.metric == "percent_goal"
    }
}

/// `77.1 ± 0.1 (5)`: mean, standard error, number of models.
pub(crate) fn mean(summary: &Summary) -> String {
    let error = summary.standard_error.map_or_else(String::new, |error| format!(" ± {}", number(error)));
    format!("{}{error} ({})", number(summary.mean), summary.n)
}

/// A metric with one digit after the point, or as many as a small one needs.
pub(crate) fn number(value: f64) -> String {
    match value.abs() {
        size if size >= 1000.0 => format!("{value:.0}"),
        size if size >= 2.0 || value == 0.0 => format!("{value:.1}"),
        _ => format!("{value:.2}"),
    }
}

/// Rows and columns of means; the paper's numbers stand below ours, where a pipeline is labelled with them.
pub(crate) fn short(grid: &Grid, about: About<'_>, format: Format, paint: Paint) -> String {
    let mut rows = vec![vec![about.rows.to_owned()]];
    rows[0].extend(grid.cols.iter().cloned());
    for row in 0..grid.rows.len() {
        let cells = || (0..grid.cols.len()).map(|col| grid.cell(row, col));
        let shown = cells().map(|cell| cell.map_or_else(String::new, |it| mean(&it.summary)));
        rows.push(std::iter::once(grid.rows[row].clone()).chain(shown).collect());
        let papers: Vec<&str> = cells().map(|cell| cell.and_then(|it| it.label("paper")).unwrap_or_default()).collect();
        if about.is_goal() && papers.iter().any(|paper| !paper.is_empty()) {
            let shown = papers.iter().map(|paper| (*paper).to_owned());
            rows.push(std::iter::once("  the paper's".to_owned()).chain(shown).collect());
        }
    }
    laid_out(rows, format, paint)
}

/// One row for each series, with every statistic.
pub(crate) fn long(
    grid: &Grid,
    about: About<'_>,
    format: Format,
    paint: Paint,
    store: &Store,
) -> Result<String, Error> {
    let mut rows = Vec::new();
    for (row, col, series) in &grid.cells {
        rows.push(long_row(&grid.rows[*row], &grid.cols[*col], series, about, store)?);
    }
    let header = rows.first().map_or_else(Vec::new, |row| row.iter().map(|it| it.0.clone()).collect());
    let empty = |at: usize| rows.iter().all(|row| row[at].1.is_empty());
    let kept: Vec<usize> = (0..header.len()).filter(|&at| !empty(at)).collect();
    let pick = |row: Vec<String>| kept.iter().map(|&at| row[at].clone()).collect::<Vec<_>>();
    let body = rows.iter().map(|row| pick(row.iter().map(|it| it.1.clone()).collect()));
    let all = std::iter::once(pick(header)).chain(body).collect();
    Ok(laid_out(all, format, paint))
}

type Named = (String, String);

fn long_row(row: &str, col: &str, series: &Series, about: About<'_>, store: &Store) -> Result<Vec<Named>, Error> {
    let summary = &series.summary;
    let five = |mean: crate::num::stats::Mean| {
        let of = if mean.of < crate::num::stats::FIVE { format!(" (of {})", mean.of) } else { String::new() };
        format!("{}{of}", number(mean.mean))
    };
    let interval = |[low, high]: [f64; 2]| format!("{} to {}", number(low), number(high));
    let mut cells: Vec<(&str, String)> = vec![
        (about.rows, row.to_owned()),
        (about.cols, col.to_owned()),
        ("mean ± s.e. (models)", mean(summary)),
        ("95 % interval", summary.ci95.map_or_else(String::new, interval)),
        ("best", number(summary.best)),
        ("top five", five(summary.top_five)),
        ("worst five", five(summary.worst_five)),
        ("worst", number(summary.worst)),
    ];
    if about.is_goal() {
        for (name, metric) in [("policy alone", "policy_alone"), ("counting T", "percent_goal_t")] {
            let other = series.summary_of(metric, store)?;
            cells.push((name, other.map_or_else(String::new, |it| number(it.mean))));
        }
        let ceiling = series.ceiling();
        cells.push(("ceiling", ceiling.map_or_else(String::new, |it| format!("{it:.1}"))));
        let share = ceiling.map(|ceiling| format!("{:.1} %", 100.0 * summary.mean / ceiling));
        cells.push(("share of ceiling", share.unwrap_or_default()));
        cells.push(("paper", series.label("paper").unwrap_or_default().to_owned()));
    }
    let [least, most] = series.samples();
    cells.push((
        "samples",
        if least == most { thousands(least) } else { format!("{} to {}", thousands(least), thousands(most)) },
    ));
    cells.push(("seeds", series.seeds()));
    cells.push(("pipeline", file(series)));
    cells.push(("commit", series.commits()));
    Ok(cells.into_iter().map(|(name, value)| (name.to_owned(), value)).collect())
}

fn file(series: &Series) -> String {
    let member = &series.first().member;
    let name = std::path::Path::new(&member.file).file_name().map(|name| name.to_string_lossy().into_owned());
    name.unwrap_or_else(|| member.pipeline.clone())
}

/// `3,072`.
fn thousands(count: u64) -> String {
    let digits = count.to_string();
    let mut text = String::new();
    for (at, digit) in digits.chars().enumerate() {
        if at > 0 && (digits.len() - at).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

fn laid_out(mut rows: Vec<Vec<String>>, format: Format, paint: Paint) -> String {
    if format == Format::Markdown {
        let line = |row: &Vec<String>| {
            let cells: Vec<String> = row.iter().map(|cell| cell.trim().replace('|', "\\|")).collect();
            format!("| {} |\n", cells.join(" | "))
        };
        let rule = format!("|{}\n", "---|".repeat(rows.first().map_or(0, Vec::len)));
        let mut lines = rows.iter().map(line);
        return lines.next().into_iter().chain([rule]).chain(lines).collect();
    }
    if let Some(header) = rows.first_mut() {
        header.iter_mut().for_each(|cell| *cell = paint.bold(cell));
    }
    out::table(&rows)
}

/// Every cell as one line, with every statistic.
pub(crate) fn csv(grid: &Grid, about: About<'_>, store: &Store) -> Result<String, Error> {
    let objects = objects(grid, about, store)?;
    let Some(Value::Object(first)) = objects.first() else { return Ok(String::new()) };
    let names: Vec<&String> = first.keys().filter(|name| *name != "models").collect();
    let quoted = |value: &Value| {
        let text = match value {
            Value::Null => String::new(),
            Value::String(text) => text.clone(),
            other => other.to_string(),
        };
        if text.contains([',', '"', '\n', '\r']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text }
    };
    let mut text = names.iter().map(|name| name.as_str()).collect::<Vec<_>>().join(",") + "\n";
    for object in &objects {
        text += &names.iter().map(|name| quoted(&object[name.as_str()])).collect::<Vec<_>>().join(",");
        text.push('\n');
    }
    Ok(text)
}

/// One JSON object.
pub(crate) fn json(grid: &Grid, about: About<'_>, store: &Store) -> Result<String, Error> {
    let cells = objects(grid, about, store)?;
    let object = json!({
        "version": 1, "metric": about.metric, "rows": about.rows, "cols": about.cols,
        "resamples": crate::num::stats::RESAMPLES, "cells": cells,
    });
    Ok(format!("{object}\n"))
}

fn objects(grid: &Grid, about: About<'_>, store: &Store) -> Result<Vec<Value>, Error> {
    let mut objects = Vec::new();
    for (row, col, series) in &grid.cells {
        let (it, summary) = (series.first(), &series.summary);
        let ci95 = summary.ci95.map_or([None; 2], |ci| ci.map(Some));
        let [least, most] = series.samples();
        let mut object = json!({
            "row": grid.rows[*row], "col": grid.cols[*col], "metric": about.metric,
            "task": it.task_name(), "algorithm": field(it, "algorithm"), "pipeline": it.member.pipeline,
            "file": it.member.file, "stage": it.stage, "n": summary.n, "mean": summary.mean,
            "standard_error": summary.standard_error, "ci95_low": ci95[0], "ci95_high": ci95[1],
            "best": summary.best, "worst": summary.worst,
            "top_five": summary.top_five.mean, "top_five_of": summary.top_five.of,
            "worst_five": summary.worst_five.mean, "worst_five_of": summary.worst_five.of,
            "samples": least, "samples_most": most, "seeds": series.seeds(), "commit": series.commits(),
        });
        if about.is_goal() {
            let mean_of = |metric| Ok::<_, Error>(series.summary_of(metric, store)?.map(|it| it.mean));
            object["policy_alone"] = json!(mean_of("policy_alone")?);
            object["percent_goal_t"] = json!(mean_of("percent_goal_t")?);
            object["ceiling"] = json!(series.ceiling());
            object["share_of_ceiling"] = json!(series.ceiling().map(|ceiling| 100.0 * summary.mean / ceiling));
            object["paper"] = json!(series.label("paper"));
        }
        let model = |(outcome, value): (&crate::report::outcomes::Outcome, &f64)| {
            json!({"seed": outcome.seed, "value": value, "samples": outcome.samples, "run": outcome.run,
                   "node": outcome.node, "output": outcome.output})
        };
        object["models"] = series.outcomes.iter().zip(&series.values).map(model).collect();
        objects.push(object);
    }
    Ok(objects)
}
