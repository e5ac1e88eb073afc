//! A table with one row for each series and one column for each statistic.

use super::{About, Rows, grid::Grid};
use crate::{
    num::stats::{FIVE, Mean},
    report::{
        numbers::{mean, number, thousands},
        series::{SampleRange, Series},
    },
    store::ResultStore,
};

/// A statistic of a series.
struct Column {
    name: String,
    value: String,
}

/// One row for each series, with every statistic. Columns that are empty in every row are left out.
///
/// # Errors
/// The store cannot be read.
pub fn long(grid: &Grid, about: About<'_>, store: &dyn ResultStore) -> anyhow::Result<Rows> {
    let mut rows = Vec::new();
    for cell in &grid.cells {
        let mut columns = vec![column(about.rows, &grid.rows[cell.row]), column(about.cols, &grid.cols[cell.col])];
        columns.extend(statistics(&cell.series));
        if about.is_percent_goal() {
            columns.extend(goal(&cell.series, store)?);
        }
        columns.extend(origin(&cell.series));
        rows.push(columns);
    }
    let names = rows.first().map_or_else(Vec::new, |row| row.iter().map(|it| it.name.clone()).collect());
    let kept: Vec<usize> = (0..names.len()).filter(|&at| rows.iter().any(|row| !row[at].value.is_empty())).collect();
    let body = rows.iter().map(|row| kept.iter().map(|&at| row[at].value.clone()).collect());
    Ok(Rows { header: kept.iter().map(|&at| names[at].clone()).collect(), body: body.collect() })
}

fn column(name: &str, value: impl Into<String>) -> Column {
    Column { name: name.to_owned(), value: value.into() }
}

fn statistics(series: &Series) -> [Column; 6] {
    let summary = series.summary();
    let five = |mean: Mean| {
        let of = if mean.of < FIVE { format!(" (of {})", mean.of) } else { String::new() };
        format!("{}{of}", number(mean.mean))
    };
    let interval = |[low, high]: [f64; 2]| format!("{} to {}", number(low), number(high));
    [
        column("mean ± s.e. (models)", mean(series.estimate())),
        column("95 % interval", summary.ci95.map_or_else(String::new, interval)),
        column("best", number(summary.best)),
        column("top five", five(summary.top_five)),
        column("worst five", five(summary.worst_five)),
        column("worst", number(summary.worst)),
    ]
}

/// What is known only of the share of time at the goal.
fn goal(series: &Series, store: &dyn ResultStore) -> anyhow::Result<[Column; 6]> {
    let mean_of =
        |metric| -> anyhow::Result<String> { Ok(series.mean_of(metric, store)?.map_or_else(String::new, number)) };
    let ceiling = series.ceiling();
    let share = ceiling.map(|ceiling| format!("{:.1} %", 100.0 * series.estimate().mean / ceiling));
    Ok([
        column("policy alone", mean_of("policy_alone")?),
        column("counting T", mean_of("percent_goal_t")?),
        column("ceiling", ceiling.map_or_else(String::new, |it| format!("{it:.1}"))),
        column("share of ceiling", share.unwrap_or_default()),
        column("paper", series.label("paper").unwrap_or_default()),
        column("beyond the paper", series.label("additions").unwrap_or_default()),
    ])
}

/// What the models were made from.
fn origin(series: &Series) -> [Column; 4] {
    let SampleRange { least, most } = series.samples();
    let samples = if least == most { thousands(least) } else { format!("{} to {}", thousands(least), thousands(most)) };
    let member = &series.first().member;
    let file = std::path::Path::new(&member.file).file_name().map(|name| name.to_string_lossy().into_owned());
    [
        column("samples", samples),
        column("seeds", series.seeds()),
        column("pipeline", file.unwrap_or_else(|| member.pipeline.clone())),
        column("commit", series.commits()),
    ]
}
