//! `carl-pipe verify`: reads every result, names what is damaged, and makes it again with `--repair`.

#![allow(clippy::disallowed_methods, reason = "wall time is shown to people; no result holds it")]

use std::{path::PathBuf, time::Instant};

use serde_json::{Value, json};

use super::{
    Global,
    exit::{Error, Exit},
    out::{self, duration},
    stop::Stop,
    working::WorkingArgs,
};
use crate::{
    run::{
        holdings::{Holding, Holdings},
        manifest::Manifest,
        repair::{Repaired, repair},
        runs,
        verify::{Problem, Verified, run_folders, verify},
    },
    stage::Kind,
    store::{Fault, LocalStore, ResultStore as _},
};

/// The arguments of `verify`.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Reads the bytes of every result and recording, and changes nothing without `--repair`. A plain \
`run` trusts a file that nobody has touched, and never runs a node for its recording alone.

`--repair` moves damaged files to `bad/`. Then it runs the nodes again that a kept run needs, with their recorded inputs, \
and checks that each output has the same bytes. Exit code 5 if something stays damaged or missing.

Examples:
  carl-pipe verify                      all results, recordings and runs
  carl-pipe verify latest               what the newest run uses
  carl-pipe verify --repair             make again what is damaged or missing"
)]
pub(crate) struct Args {
    /// Only what this run uses: `latest`, `latest~1`, a tag, a pipeline (its newest run), a run id, or the beginning of an id.
    #[arg(value_name = "RUN")]
    run: Option<String>,
    /// Set damaged files aside, and make again what a kept run needs.
    #[arg(long)]
    repair: bool,
    #[command(flatten)]
    working: WorkingArgs,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// Verifies a store or a run.
pub(crate) fn verify_verb(global: &Global, args: &Args, kinds: &'static [Kind]) -> Result<Exit, Error> {
    let start = Instant::now();
    let store = if args.repair { global.store_to_run()? } else { global.store_to_read()? };
    let runs = match &args.run {
        Some(run) => vec![runs::find(&global.runs(), run)?],
        None => run_folders(&global.runs())?,
    };
    let found = verify(&store, &runs, args.run.is_none());
    let secs = start.elapsed().as_secs_f64();
    if !args.json {
        print(&found, secs);
    }
    let mut exit = if found.problems.is_empty() { Exit::Ok } else { Exit::Damaged };
    let mut repaired = None;
    if args.repair && exit == Exit::Damaged {
        let (done, is_stopped) = repair_all(global, args, &store, &runs, &found, kinds)?;
        let left = verify(&store, &runs, args.run.is_none()).problems;
        exit = match left.is_empty() {
            _ if is_stopped => Exit::Interrupted,
            true => Exit::Ok,
            false => Exit::Damaged,
        };
        if !args.json {
            print_repaired(&done, &left);
            help(&left, true, global, &store)?;
        }
        repaired = Some((done, left));
    } else if !args.json {
        help(&found.problems, false, global, &store)?;
    }
    if args.json {
        out::json(&json_of(&found, secs, repaired.as_ref()));
    }
    Ok(exit)
}

/// Sets damaged files aside, and makes again what the runs used. True if the user has stopped it.
fn repair_all(
    global: &Global,
    args: &Args,
    store: &LocalStore,
    runs: &[PathBuf],
    found: &Verified,
    kinds: &'static [Kind],
) -> Result<(Repaired, bool), Error> {
    let is_of_store = |problem: &&Problem| problem.path.starts_with(store.root()) && problem.what != "manifest";
    for problem in found.problems.iter().filter(is_of_store) {
        if problem.fault != Fault::Missing {
            store.move_to_bad(&problem.path);
        }
        // A result that no run uses and that lacks a file is no result; whoever wants it makes it.
        if let Some(key) = problem.key.filter(|_| !problem.is_used) {
            store.move_to_bad(&store.path_of_entry(key));
        }
    }
    let stop = Stop::listen()?;
    let (options, progress) = args.working.start(stop.clone(), global, args.json, kinds);
    let scratch = store.scratch_path(&format!("verify-{}", std::process::id()));
    let kind = |name: &str| kinds.iter().find(|kind| kind.name == name);
    let mut all = Repaired::default();
    let mut result = Ok(());
    for manifest in runs.iter().filter_map(|run_dir| Manifest::read(run_dir).ok()) {
        match repair(&manifest, store, &scratch, &options, &kind, &*progress) {
            Ok(one) => {
                all.made.extend(one.made);
                all.left.extend(one.left);
            }
            Err(error) => result = Err(error),
        }
        if stop.is_asked() || result.is_err() {
            break;
        }
    }
    progress.close();
    let _ = std::fs::remove_dir_all(&scratch);
    result?;
    Ok((all, stop.is_asked()))
}

/// Says what to do about problems that a repair has not seen, or has left.
fn help(problems: &[Problem], is_repaired: bool, global: &Global, store: &LocalStore) -> Result<(), Error> {
    let (manifests, results): (Vec<_>, Vec<_>) = problems.iter().partition(|problem| problem.what == "manifest");
    let help = out::bold("help:");
    if !results.is_empty() && !is_repaired {
        out::note(&format!("  = {help} `carl-pipe verify --repair` makes it again"));
    }
    if manifests.is_empty() {
        return Ok(());
    }
    let holdings = Holdings::read(store, &global.runs())?;
    for run in manifests.iter().filter_map(|problem| problem.run.as_ref()) {
        let Some(holding) = holdings.runs.iter().find(|holding| holding.id == *run) else { continue };
        out::note(&format!("  = {help} {}", of_lost_manifest(holding)));
    }
    Ok(())
}

/// What is left of a run whose manifest cannot be read, and what to do.
fn of_lost_manifest(run: &Holding) -> String {
    let Holding { id, pipeline, results, .. } = run;
    let of = pipeline.as_ref().map_or_else(String::new, |name| format!(" of `{name}`"));
    let left = match results.len() {
        0 => "none of its results is left".to_owned(),
        count => format!("{count} of its results are left, and `carl-pipe run` of its file takes them into a new run"),
    };
    format!("the manifest of run {id}{of} cannot be made again; {left}; `carl-pipe gc --drop {id}` removes the run")
}

fn count(problems: &[Problem]) -> String {
    if let [_] = problems { "1 problem".to_owned() } else { format!("{} problems", problems.len()) }
}

/// What is wrong, in one word.
fn word(fault: &Fault) -> &'static str {
    match fault {
        Fault::Damaged => "damaged",
        Fault::Missing => "missing",
        Fault::Unreadable(_) => "unreadable",
    }
}

fn print(found: &Verified, secs: f64) {
    out::print(&out::table(&found.problems.iter().map(row).collect::<Vec<_>>()));
    let Verified { runs, entries, objects, bytes, problems } = found;
    let result = if problems.is_empty() { "all whole".to_owned() } else { count(problems) };
    let read = format!("{entries} results, {objects} files ({}) and {runs} runs", out::bytes(*bytes));
    out::line(&out::bold(&format!("read {read} in {}: {result}", duration(secs))));
}

fn row(problem: &Problem) -> Vec<String> {
    let node = problem.node.as_ref().map_or_else(String::new, |node| format!("of {node}"));
    let run = match &problem.run {
        Some(run) if problem.is_used => format!("run {run}"),
        Some(run) => format!("made by run {run}, used by none"),
        None => "used by no run".to_owned(),
    };
    let why = match &problem.fault {
        Fault::Unreadable(why) => format!("{}: {}", problem.path.display(), out::tidy(why)),
        _ => problem.path.display().to_string(),
    };
    vec![out::red(word(&problem.fault)), format!("{} {node}", problem.what), run, why]
}

fn print_repaired(repaired: &Repaired, left: &[Problem]) {
    for (node, why) in &repaired.left {
        out::note(&format!("{} {node} was not made again: {why}", out::red("error:")));
    }
    out::print(&out::table(&left.iter().map(row).collect::<Vec<_>>()));
    let text = if left.is_empty() { "all whole".to_owned() } else { format!("{} left", count(left)) };
    out::line(&out::bold(&format!("made {} nodes again: {text}", repaired.made.len())));
}

fn json_of(found: &Verified, secs: f64, repaired: Option<&(Repaired, Vec<Problem>)>) -> Value {
    let problem = |it: &Problem| {
        let why = if let Fault::Unreadable(why) = &it.fault { Some(why) } else { None };
        json!({ "what": it.what, "problem": word(&it.fault), "why": why, "node": it.node, "run": it.run,
            "path": it.path.to_string_lossy() })
    };
    let problems = |all: &[Problem]| all.iter().map(problem).collect::<Vec<_>>();
    let repaired = repaired.map(|(done, left)| {
        let failed: Vec<Value> = done.left.iter().map(|(node, why)| json!({"node": node, "why": why})).collect();
        json!({ "made": done.made, "failed": failed, "problems": problems(left) })
    });
    json!({
        "version": 1, "runs": found.runs, "entries": found.entries, "objects": found.objects, "bytes": found.bytes,
        "secs": secs, "problems": problems(&found.problems), "repaired": repaired,
    })
}
