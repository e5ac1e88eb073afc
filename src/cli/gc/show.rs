//! Prints what a cleaning removes and keeps.

use crate::{
    cli::out,
    report::groups::grouped,
    run::gc::{KeptRun, Plan, Reason, RemovedRun},
};

/// Prints what goes by pipeline, and which runs stay for a reason that a user may want to know.
pub(super) fn print(plan: &Plan, is_verbose: bool) {
    let name = |pipeline: &Option<String>| pipeline.clone().unwrap_or_else(|| "(unknown pipeline)".to_owned());
    let mut rows = Vec::new();
    let row = |name: String, runs: usize, entries: usize, bytes: u64| {
        vec![format!("  {name}"), count(runs, "run"), count(entries, "result"), out::bytes(bytes)]
    };
    let (mut entries, mut bytes) = (plan.entries, plan.bytes);
    for (pipeline, own) in grouped(&plan.removed, |run| name(&run.pipeline)) {
        let sum = |part: fn(&RemovedRun) -> u64| own.iter().map(|run| part(run)).sum::<u64>();
        let own_entries = sum(|run| run.entries as u64) as usize;
        rows.push(row(pipeline, own.len(), own_entries, sum(|run| run.bytes)));
        if is_verbose {
            rows.extend(own.iter().map(|run| row(format!("  {}", run.run), 1, run.entries, run.bytes)));
        }
        entries = entries.saturating_sub(own_entries);
        bytes = bytes.saturating_sub(sum(|run| run.bytes));
    }
    if entries > 0 || bytes > 0 {
        rows.push(row("what no run names".to_owned(), 0, entries, bytes));
    }
    let title = if rows.is_empty() { "nothing to remove" } else { "to remove" };
    out::line(&out::bold(&format!(
        "{title}: {} of {}",
        out::bytes(plan.bytes),
        out::bytes(plan.bytes + plan.kept_bytes)
    )));
    out::print(&out::table(&rows));
    let kept = match plan.kept.len() {
        0 => "no run".to_owned(),
        runs => count(runs, "run"),
    };
    out::line(&out::bold(&format!("to keep: {kept}, {}", out::bytes(plan.kept_bytes))));
    let is_special = |run: &&KeptRun| is_verbose || run.problem.is_some() || matches!(run.reason, Reason::Pinned);
    let kept: Vec<_> = plan.kept.iter().filter(is_special).collect();
    out::print(&out::table(
        &kept.iter().map(|run| vec![format!("  {}", run.run), name(&run.pipeline), why(run)]).collect::<Vec<_>>(),
    ));
    for run in plan.kept.iter().filter(|run| run.problem.is_some()) {
        out::note(&format!("  = {} `carl-pipe gc --drop {}` removes it", out::bold("help:"), run.run));
    }
}

fn count(number: usize, what: &str) -> String {
    match number {
        0 => String::new(),
        1 => format!("1 {what}"),
        _ => format!("{number} {what}s"),
    }
}

fn why(run: &KeptRun) -> String {
    let reason = match run.reason {
        Reason::Running => "in progress",
        Reason::Pinned => "pinned or tagged",
        Reason::Unreadable => "kept with the results that it may name",
        Reason::Latest => "the newest run",
        Reason::NewestOfPipeline => "the newest of its pipeline",
        Reason::Recent => "among the newest of its pipeline",
        Reason::Young => "not old enough",
        Reason::NotAsked => "not asked for",
    };
    match run.problem {
        Some(problem) if run.keeps_all => out::yellow(&format!(
            "{problem}: the results of this run are unknown, so all results stay; `carl-pipe gc --drop` removes the run"
        )),
        Some(problem) => out::yellow(&format!("{problem}: {reason} ({})", run.entries)),
        None => reason.to_owned(),
    }
}
