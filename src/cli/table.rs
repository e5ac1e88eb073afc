//! `carl-pipe table`: prints the results of runs as a table, beside the paper's numbers.

use std::collections::BTreeSet;

use super::{
    Global,
    exit::{Error, Exit},
    out,
};
use crate::{
    diag::{instead, visible},
    report::{
        outcomes::{Outcome, outcomes},
        series::pooled,
        table::{About, Grid, Rows, UnknownField, csv, json, long, short},
    },
    stage::Kind,
};

/// The arguments of `table`.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "A cell shows the mean over models (one for each seed) in their last round, with its standard error \
and the number of models. Several runs are pooled. The same seed of the same recipe counts once. `--long`, csv and json \
add the best and the worst five models, a 95 % percentile bootstrap interval over models, the share of the best possible \
controller, and the origin of each number.

Examples:
  carl-pipe table latest
  carl-pipe table latest --long --format markdown
  carl-pipe table 20261122-0748 20261123-0912 --rows pipeline --cols samples
  carl-pipe table latest --metric map_quality --format csv"
)]
pub(crate) struct Args {
    /// The runs: `latest`, `latest~1`, tags, pipelines, ids, or beginnings of ids.
    #[arg(value_name = "RUN", default_value = "latest")]
    runs: Vec<String>,
    /// The field of the rows: task, pipeline, stage, round, samples, seed, a label or an axis of a matrix.
    #[arg(long, value_name = "FIELD", default_value = "task")]
    rows: String,
    /// The field of the columns.
    #[arg(long, value_name = "FIELD", default_value = "algorithm")]
    cols: String,
    /// The metric, such as percent_goal, percent_goal_t, policy_alone, samples or map_quality; the headline of the
    /// results if not given.
    #[arg(long, value_name = "NAME")]
    metric: Option<String>,
    /// Show all rounds, not only the last one.
    #[arg(long)]
    all_rounds: bool,
    /// One row for each pipeline, with every statistic.
    #[arg(long)]
    long: bool,
    /// text, markdown, csv or json.
    #[arg(long, value_name = "HOW", default_value = "text", value_enum, hide_possible_values = true)]
    format: Format,
}

/// The format of a table.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Format {
    Text,
    Markdown,
    Csv,
    Json,
}

/// Prints a table.
pub(crate) fn table(global: &Global, args: &Args, kinds: &[Kind]) -> Result<Exit, Error> {
    let store = global.store_to_read()?;
    let mut all = all_outcomes(global, &args.runs, kinds)?;
    let by_round = args.all_rounds || [&args.rows, &args.cols].iter().any(|field| *field == "round");
    all.retain(|outcome| outcome.is_last || by_round);
    let Some(first) = all.first() else {
        return Err(Error::usage(format!("no evaluation of the last round is finished in {}", args.runs.join(", ")))
            .help("add a stage of kind `evaluate`, or wait until the run ends"));
    };
    let metric = args.metric.clone().unwrap_or_else(|| first.headline.to_owned());
    let known: BTreeSet<String> = all.iter().flat_map(|outcome| outcome.metrics.keys().cloned()).collect();
    let over_seeds = [&args.rows, &args.cols].iter().all(|field| *field != "seed");
    let series = pooled(all, &metric, over_seeds, &store)?;
    if series.is_empty() {
        let known = known.iter().map(String::as_str).chain(["samples", "percent_goal_t"]);
        return Err(
            Error::usage(format!("no result has the metric `{metric}`")).help(instead(&metric, "metrics", known))
        );
    }
    let grid = Grid::new(series, &args.rows, &args.cols)?;
    let about = About { metric: &metric, rows: &args.rows, cols: &args.cols };
    let rows = |is_long| if is_long { long(&grid, about, &store) } else { Ok(short(&grid, about)) };
    match args.format {
        Format::Csv => out::print(&csv(&grid, about, &store)?),
        Format::Json => out::json_text(json(&grid, about, &store)?.trim_end()),
        Format::Markdown => out::print(&one_line_cells(rows(args.long)?).markdown()),
        Format::Text => out::print(&text(rows(args.long)?)),
    }
    Ok(Exit::Ok)
}

/// The rows, with labels that cannot break a line of Markdown.
fn one_line_cells(mut rows: Rows) -> Rows {
    for cell in rows.header.iter_mut().chain(rows.body.iter_mut().flatten()) {
        *cell = visible(cell).into_owned();
    }
    rows
}

/// Rows in columns, with a bold header.
pub(crate) fn text(rows: Rows) -> String {
    let header = rows.header.iter().map(|name| out::bold(name)).collect();
    let all: Vec<Vec<String>> = std::iter::once(header).chain(rows.body).collect();
    out::table(&all)
}

/// The outcomes of runs, newest run first, so that the newest of equal outcomes counts.
pub(crate) fn all_outcomes(global: &Global, wanted: &[String], kinds: &[Kind]) -> Result<Vec<Outcome>, Error> {
    let mut manifests: Vec<_> = wanted.iter().map(|run| global.manifest(run)).collect::<Result<_, _>>()?;
    manifests.sort_by(|a, b| (b.number, &b.run).cmp(&(a.number, &a.run)));
    manifests.dedup_by(|a, b| a.run == b.run);
    Ok(manifests.iter().flat_map(|manifest| outcomes(manifest, kinds)).collect())
}

impl From<UnknownField> for Error {
    fn from(unknown: UnknownField) -> Self {
        let help = instead(&unknown.name, "fields", unknown.known.iter().map(String::as_str));
        Self::usage(unknown.to_string()).help(help)
    }
}
