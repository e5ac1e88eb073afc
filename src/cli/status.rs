//! `carl-pipe status`: what is stale and why. Runs nothing.

use std::collections::BTreeSet;

use serde_json::{Map, Value, json};

use super::{
    Global,
    exit::{Error, Exit},
    file::{self, PipelineArgs},
    out::{self, Paint},
};
use crate::{
    pipeline::Graph,
    report::groups::grouped,
    run::{
        plan::{Force, Plan, State, plan},
        why::{History, Reason, reason},
    },
    stage::Kind,
};

/// The arguments of `status`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    file: PipelineArgs,
    /// Stages or nodes to look at, with all they need; all if none is given.
    #[arg(value_name = "TARGET")]
    targets: Vec<String>,
    /// One JSON object.
    #[arg(long)]
    json: bool,
}

/// With more rows than this, nodes with the same reason are shown by stage, and those of a suite by member.
const ROWS: usize = 24;

/// Says what is stale.
pub(crate) fn status(global: &Global, args: &Args, kinds: &'static [Kind]) -> Result<Exit, Error> {
    let loaded = file::load(&args.file.pipeline, &args.file.changes, kinds, global.color, args.json)?;
    let wanted = file::pick(&loaded.graph, &args.targets)?;
    let store = global.store()?;
    let plan = plan(&loaded.graph, &wanted, &store, &Force::None)?;
    show(&loaded.graph, &plan, &mut History::new(&global.runs()), args.json, global);
    let is_fresh = plan.iter().flatten().all(|state| matches!(state, State::Hit(..)));
    Ok(if is_fresh { Exit::Ok } else { Exit::Stale })
}

/// Prints a plan: fresh nodes as a number, the others with their reasons.
pub(crate) fn show(graph: &Graph, plan: &Plan, history: &mut History, json: bool, global: &Global) {
    let reasons: Vec<(&str, Reason)> = (0..graph.nodes.len())
        .filter_map(|id| Some((graph.nodes[id].name.as_str(), reason(graph, plan, id, history)?)))
        .collect();
    let count = |test: fn(&Reason) -> bool| reasons.iter().filter(|(_, reason)| test(reason)).count();
    let cached = count(|reason| matches!(reason, Reason::Cached));
    let waiting = count(|reason| matches!(reason, Reason::Waiting { .. }));
    let stale = reasons.len() - cached - waiting;
    if json {
        let nodes: Map<String, Value> =
            reasons.iter().map(|(name, reason)| ((*name).to_owned(), json!(reason))).collect();
        let object = json!({
            "version": 1, "pipeline": graph.name, "cached": cached, "stale": stale, "waiting": waiting, "nodes": nodes,
        });
        out::line(&object.to_string());
        return;
    }
    let paint = global.color.on_stdout();
    out::print(&out::table(&rows(graph, &reasons, global.verbose, paint)));
    let text = match (stale, waiting) {
        (0, 0) => format!("{}: all {cached} nodes are up to date", graph.name),
        (stale, 0) => format!("{}: {stale} to run, {cached} cached", graph.name),
        (stale, waiting) => {
            format!("{}: {stale} to run, {waiting} after them if these change, {cached} cached", graph.name)
        }
    };
    out::line(&paint.bold(&text));
}

/// A row for each node that is not up to date; where these are many, nodes of a stage that wait share one.
fn rows(graph: &Graph, reasons: &[(&str, Reason)], verbose: bool, paint: Paint) -> Vec<Vec<String>> {
    let shown: Vec<_> = reasons.iter().filter(|(_, reason)| verbose || !matches!(reason, Reason::Cached)).collect();
    let fold = !verbose && shown.len() > ROWS;
    let stages = shown.iter().map(|(name, _)| name.split(['@', '[']).next()).collect::<BTreeSet<_>>().len();
    let by_member = fold && graph.is_suite() && stages > ROWS;
    let group = |name: &'_ str| {
        let end = if by_member { name.find('/') } else { name.find(['@', '[']) };
        name[..end.unwrap_or(name.len())].to_owned()
    };
    let told = |reason: &Reason| match reason {
        Reason::Cached => (paint.dim("cached"), String::new()),
        Reason::Waiting { changes, .. } if fold => {
            let changes: Vec<_> = changes.iter().map(ToString::to_string).collect();
            (paint.dim("waiting"), changes.join(", "))
        }
        Reason::Waiting { .. } => (paint.dim("waiting"), reason.to_string()),
        _ => (paint.yellow("stale"), reason.to_string()),
    };
    let key = |(name, reason): &&(&str, Reason)| {
        let (state, why) = told(reason);
        // The rows of a suite's members would be too many with one for each reason: the first reason stands for all.
        if fold {
            (group(name), state, if by_member { String::new() } else { why })
        } else {
            (name.to_string(), state, why)
        }
    };
    let row = |((group, state, _), own): ((String, String, String), Vec<&(&str, Reason)>)| {
        let (name, reason) = own[0];
        let name = if own.len() > 1 { format!("{group} x{}", own.len()) } else { (*name).to_owned() };
        vec![name, state, told(reason).1]
    };
    grouped(shown, key).into_iter().map(row).collect()
}
