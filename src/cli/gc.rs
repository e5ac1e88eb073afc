//! `carl-pipe gc`: deletes old runs and the results that no kept run uses.

mod show;

use std::{
    collections::BTreeSet,
    io::{IsTerminal as _, stderr, stdin},
};

use serde_json::json;

use super::{
    Global,
    exit::{Error, Exit},
    out,
};
use crate::{
    run::{
        gc::{self, Limits, Policy},
        marks::Marks,
        runs,
    },
    store::LocalStore,
};

/// The arguments of `gc`.
#[derive(Debug, clap::Args)]
#[command(after_help = "`gc` counts runs by pipeline. Runs count as one if one of them has the results of all: \
a run that found everything cached pushes nothing out. A failed or interrupted run stays until N newer runs of its pipeline have \
finished. Always kept: the newest run, runs with a pin or a tag, runs in progress, and runs whose manifest cannot be \
read, with every result that they may name. `--max-size` also keeps the newest run of each pipeline, and the newest \
that finished.

Examples:
  carl-pipe gc --dry-run
  carl-pipe gc --keep 3 --older-than 30d --yes
  carl-pipe gc --max-size 20GB
  carl-pipe gc --drop 20261122-0748                       remove one run and what only it names")]
pub(crate) struct Args {
    /// Keep the newest N runs of each pipeline and all results that they use.
    #[arg(long, value_name = "N", default_value_t = 10)]
    keep: usize,
    /// Remove only runs that are older than this, such as 30d, 12h or 2w.
    #[arg(long, value_name = "AGE", value_parser = age)]
    older_than: Option<u64>,
    /// Then remove further runs, oldest first, until all takes no more than this, such as 500MB or 20GB.
    #[arg(long, value_name = "SIZE", value_parser = size)]
    max_size: Option<u64>,
    /// Remove this run and no other run; repeatable.
    #[arg(long, value_name = "RUN", conflicts_with_all = ["keep", "older_than", "max_size"])]
    drop: Vec<String>,
    /// Do not ask.
    #[arg(short, long)]
    yes: bool,
    /// Only show what would be removed.
    #[arg(short = 'n', long, conflicts_with = "yes")]
    dry_run: bool,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// `30d` in seconds.
fn age(text: &str) -> Result<u64, String> {
    let units = [("s", 1.0), ("min", 60.0), ("h", 3600.0), ("d", 86_400.0), ("w", 604_800.0)];
    quantity(text, &units).ok_or_else(|| "write a number and s, min, h, d or w, such as `30d`".to_owned())
}

/// `20GB` in bytes.
fn size(text: &str) -> Result<u64, String> {
    let units = [("b", 1.0), ("kb", 1e3), ("mb", 1e6), ("gb", 1e9), ("tb", 1e12)];
    quantity(&text.to_lowercase(), &units)
        .ok_or_else(|| "write a number and B, kB, MB, GB or TB, such as `20GB`".to_owned())
}

fn quantity(text: &str, units: &[(&str, f64)]) -> Option<u64> {
    let at = text.find(|c: char| c.is_alphabetic())?;
    let number: f64 = text[..at].trim().parse().ok().filter(|number| *number >= 0.0)?;
    let (_, factor) = units.iter().find(|(unit, _)| *unit == &text[at..])?;
    Some((number * factor) as u64)
}

/// Removes old runs and results. No run may be in progress.
pub(crate) fn gc(global: &Global, args: &Args) -> Result<Exit, Error> {
    let policy = policy(global, args)?;
    let runs = global.runs();
    if !args.dry_run {
        // Nobody is asked what cannot be done.
        drop(LocalStore::open_alone(&global.artifacts)?);
    }
    let shown = gc::plan(&global.store_to_read()?, &runs, &policy)?;
    if !args.json {
        show::print(&shown, global.verbose);
    }
    let is_to_remove = !args.dry_run && !shown.is_empty();
    if is_to_remove && !args.yes && !is_agreed(args.json)? {
        return Ok(Exit::Ok);
    }
    if !args.dry_run {
        // Even if no run and no result goes: a killed process may have left temporary files and folders.
        let store = LocalStore::open_alone(&global.artifacts)?;
        let plan = gc::plan(&store, &runs, &policy)?;
        if (&plan.removed, &plan.kept) != (&shown.removed, &shown.kept) {
            return Err(Error::new(Exit::Busy, "runs changed meanwhile, so nothing was removed")
                .help("run `carl-pipe gc` again"));
        }
        gc::remove(&store, &runs, &plan)?;
    }
    if args.json {
        out::json(&json!({"version": 1, "dry_run": !is_to_remove, "removed": {
            "runs": shown.removed, "entries": shown.entries, "objects": shown.objects, "bytes": shown.bytes,
        }, "kept": {"runs": shown.kept, "bytes": shown.kept_bytes}}));
    } else if is_to_remove {
        out::line(&out::bold("removed"));
    }
    Ok(Exit::Ok)
}

fn policy(global: &Global, args: &Args) -> Result<Policy, Error> {
    if args.drop.is_empty() {
        let Args { keep, older_than, max_size, .. } = *args;
        return Ok(Policy::Limits(Limits { keep, older_than_secs: older_than, max_bytes: max_size }));
    }
    let mut ids = BTreeSet::new();
    for wanted in &args.drop {
        let path = runs::find(&global.runs(), wanted)?;
        let id = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if Marks::read(&path).is_ok_and(|marks| marks.keep()) {
            return Err(Error::usage(format!("run {id} has a pin or a tag"))
                .help(format!("`carl-pipe unpin {id}` and `carl-pipe tag {id} --remove` take them away")));
        }
        ids.insert(id);
    }
    Ok(Policy::Drop(ids))
}

/// Asks whether to remove what was shown.
fn is_agreed(is_json: bool) -> Result<bool, Error> {
    if is_json || !stdin().is_terminal() || !stderr().is_terminal() {
        return Err(Error::usage("nothing was removed, since there is no terminal to ask on")
            .help("`carl-pipe gc --yes` removes without asking, `carl-pipe gc --dry-run` only shows"));
    }
    out::note("remove? [y/N]");
    let mut answer = String::new();
    let _ = stdin().read_line(&mut answer);
    Ok(matches!(&*answer.trim().to_ascii_lowercase(), "y" | "yes"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ages_and_sizes_have_units() {
        assert_eq!(
            (age("30d"), age("1.5h"), size("20GB"), size("1.5 kB")),
            (Ok(2_592_000), Ok(5400), Ok(20_000_000_000), Ok(1500))
        );
        for wrong in ["", "30", "d", "-1d", "30 days", "1e3x"] {
            assert!(age(wrong).is_err() && size(wrong).is_err(), "{wrong}");
        }
    }
}
