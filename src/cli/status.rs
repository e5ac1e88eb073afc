//! `carl-pipe status`: what is stale and why. Runs nothing.

use serde_json::{Map, Value, json};

use super::{
    Global,
    exit::{Error, Exit},
    file::{self, PipelineArgs},
    out,
};
use crate::{
    engine::{plan::{Force, Plan, State, plan}, why::{History, Reason, reason}},
    pipeline::Graph,
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

/// Says what is stale.
pub(crate) fn status(global: &Global, args: &Args, kinds: &'static [Kind]) -> Result<Exit, Error> {
    let loaded = file::load(&args.file.pipeline, &args.file.changes, kinds, global.color)?;
    let wanted = file::pick(&loaded.graph, &args.targets)?;
    let store = global.store()?;
    let plan = plan(&loaded.graph, &wanted, &store, &Force::None)?;
    show(&loaded.graph, &plan, &mut History::new(&store.runs()), args.json, global);
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
        let nodes: Map<String, Value> = reasons.iter().map(|(name, reason)| ((*name).to_owned(), json!(reason))).collect();
        let object = json!({
            "version": 1, "pipeline": graph.name, "cached": cached, "stale": stale, "waiting": waiting, "nodes": nodes,
        });
        out::line(&object.to_string());
        return;
    }
    let paint = global.color.on_stdout();
    let shown = reasons.iter().filter(|(_, reason)| global.verbose || !matches!(reason, Reason::Cached));
    let rows: Vec<Vec<String>> = shown
        .map(|(name, reason)| {
            let state = match reason {
                Reason::Cached => paint.dim("cached"),
                Reason::Waiting { .. } => paint.dim("waiting"),
                _ => paint.yellow("stale"),
            };
            let why = if matches!(reason, Reason::Cached) { String::new() } else { reason.to_string() };
            vec![(*name).to_owned(), state, why]
        })
        .collect();
    out::print(&out::table(&rows));
    let text = match (stale, waiting) {
        (0, 0) => format!("{}: all {cached} nodes are up to date", graph.name),
        (stale, 0) => format!("{}: {stale} to run, {cached} cached", graph.name),
        (stale, waiting) => format!("{}: {stale} to run, {waiting} after them if these change, {cached} cached", graph.name),
    };
    out::line(&paint.bold(&text));
}
