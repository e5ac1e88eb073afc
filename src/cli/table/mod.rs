//! `carl-pipe table`: what runs reached, in rows and columns, beside the paper's numbers.

pub(crate) mod grid;
pub(crate) mod render;
pub(crate) mod series;

use super::{
    Global,
    exit::{Error, Exit},
    out,
};
use crate::{
    report::outcomes::{Outcome, outcomes},
    run::{manifest::Manifest, runs},
    stage::Kind,
    store::Store,
};
use grid::Grid;
use render::About;

/// The arguments of `table`.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "A cell is the mean over models, one for each seed, of their last round, with its standard error \
and the number of models. Several runs are pooled; the same seed of the same recipe counts once. `--long`, csv and json \
add the best and the worst five, a percentile bootstrap interval (95 %, models are resampled), the share of the best \
possible controller, and where each metric is from.

Examples:
  carl-pipe table latest
  carl-pipe table latest --long --format markdown
  carl-pipe table 20261122-0748 20261123-0912 --rows pipeline --cols samples
  carl-pipe table latest --metric map_quality --format csv"
)]
pub(crate) struct Args {
    /// The runs: `latest`, ids, or beginnings of ids.
    #[arg(value_name = "RUN", default_value = "latest")]
    runs: Vec<String>,
    /// What rows are: task, pipeline, stage, round, samples, a label or an axis of a matrix.
    #[arg(long, value_name = "FIELD", default_value = "task")]
    rows: String,
    /// What columns are.
    #[arg(long, value_name = "FIELD", default_value = "algorithm")]
    cols: String,
    /// Which metric: percent_goal, percent_goal_t, policy_alone, samples, map_quality or another one of the last round.
    #[arg(long, value_name = "NAME", default_value = "percent_goal")]
    metric: String,
    /// Of all rounds, not of the last one.
    #[arg(long)]
    all_rounds: bool,
    /// One row for each pipeline, with every statistic.
    #[arg(long)]
    long: bool,
    /// text, markdown, csv or json.
    #[arg(long, value_name = "HOW", default_value = "text", value_enum, hide_possible_values = true)]
    format: Format,
}

/// How a table is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Format {
    Text,
    Markdown,
    Csv,
    Json,
}

/// Prints a table.
pub(crate) fn table(global: &Global, args: &Args, kinds: &[Kind]) -> Result<Exit, Error> {
    let store = global.store()?;
    let mut all = all_outcomes(&store, &args.runs, kinds)?;
    let by_round = args.all_rounds || [&args.rows, &args.cols].iter().any(|field| *field == "round");
    all.retain(|outcome| outcome.is_last || by_round);
    if all.is_empty() {
        return Err(Error::usage(format!("no evaluation of the last round is finished in {}", args.runs.join(", ")))
            .help("add a stage of kind `evaluate`, or let the run go on"));
    }
    let metrics: std::collections::BTreeSet<String> =
        all.iter().flat_map(|outcome| outcome.metrics.keys().cloned()).collect();
    let over_seeds = [&args.rows, &args.cols].iter().all(|field| *field != "seed");
    let series = series::pooled(all, &args.metric, over_seeds, &store)?;
    if series.is_empty() {
        let error = Error::usage(format!("no result has the metric `{}`", args.metric));
        let known: Vec<&str> = metrics.iter().map(String::as_str).chain(["samples", "percent_goal_t"]).collect();
        return Err(error.help(format!("there are {}", known.join(", "))));
    }
    let grid = Grid::new(series, &args.rows, &args.cols)?;
    let about = About { metric: &args.metric, rows: &args.rows, cols: &args.cols };
    let paint = global.color.on_stdout();
    out::print(&match args.format {
        Format::Csv => render::csv(&grid, about, &store)?,
        Format::Json => render::json(&grid, about, &store)?,
        format if args.long => render::long(&grid, about, format, paint, &store)?,
        format => render::short(&grid, about, format, paint),
    });
    Ok(Exit::Ok)
}

/// The outcomes of runs, newest run first, so that the newest of equal ones counts.
pub(crate) fn all_outcomes(store: &Store, wanted: &[String], kinds: &[Kind]) -> Result<Vec<Outcome>, Error> {
    let mut folders = Vec::new();
    for run in wanted {
        folders.push(runs::find(&store.runs(), run).map_err(|error| Error::usage(error.to_string()))?);
    }
    let mut manifests = Vec::new();
    for folder in &folders {
        manifests.push(Manifest::read(folder)?);
    }
    manifests.sort_by(|a, b| b.run.cmp(&a.run));
    manifests.dedup_by(|a, b| a.run == b.run);
    Ok(manifests.iter().flat_map(|manifest| outcomes(manifest, kinds)).collect())
}
