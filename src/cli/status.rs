//! `carl-pipe status`: shows which nodes are stale and why, without running them.

use std::collections::BTreeSet;

use serde_json::{Map, Value, json};

use super::{
    Global,
    exit::{Error, Exit},
    file::{self, PipelineArgs},
    out,
};
use crate::{
    pipeline::{Graph, Node},
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
    /// Stages or nodes to check, with all that they need; all stages if not given.
    #[arg(value_name = "TARGET")]
    targets: Vec<String>,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// With more rows than this, nodes of one stage with the same reason share a row. If there are more stages than this,
/// nodes of one member of a suite with the same state share a row.
const ROWS: usize = 24;

/// Shows the stale nodes of a pipeline.
pub(crate) fn status(global: &Global, args: &Args, kinds: &'static [Kind]) -> Result<Exit, Error> {
    let loaded = file::load(&args.file.pipeline, &args.file.changes, kinds, args.json)?;
    let wanted = file::pick(&loaded.graph, &args.targets)?;
    let store = global.store_to_read()?;
    let plan = plan(&loaded.graph, &wanted, &store, &Force::None)?;
    show(&loaded.graph, &plan, &mut History::new(&global.runs()), args.json, global);
    let is_fresh = plan.iter().flatten().all(|state| matches!(state, State::Hit(..)));
    Ok(if is_fresh { Exit::Ok } else { Exit::Stale })
}

/// Prints a plan: the number of nodes that are up to date, and the other nodes with their reasons.
pub(crate) fn show(graph: &Graph, plan: &Plan, history: &mut History, json: bool, global: &Global) {
    let planned: Vec<Planned<'_>> = (0..graph.nodes.len())
        .filter_map(|id| Some(Planned { node: &graph.nodes[id], reason: reason(graph, plan, id, history)? }))
        .collect();
    let count = |test: fn(&Reason) -> bool| planned.iter().filter(|it| test(&it.reason)).count();
    let cached = count(|reason| matches!(reason, Reason::Cached));
    let waiting = count(|reason| matches!(reason, Reason::Waiting { .. }));
    let stale = planned.len() - cached - waiting;
    if json {
        let nodes: Map<String, Value> = planned.iter().map(|it| (it.node.name.clone(), json!(it.reason))).collect();
        out::json(&json!({
            "version": 1, "pipeline": graph.name, "cached": cached, "stale": stale, "waiting": waiting, "nodes": nodes,
        }));
        return;
    }
    out::print(&out::table(&rows(graph, &planned, global.verbose)));
    let text = match (stale, waiting) {
        (0, 0) => format!("all {cached} nodes are up to date"),
        (stale, 0) => format!("{stale} to run, {cached} cached"),
        (stale, waiting) => format!("{stale} to run, {waiting} waiting for new inputs, {cached} cached"),
    };
    out::line(&out::bold(&format!("{}: {text}", graph.name)));
}

/// A node of a plan and why it has to run, or why not.
struct Planned<'a> {
    node: &'a Node,
    reason: Reason,
}

/// How nodes share rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Fold {
    /// Each node has its own row.
    Nothing,
    /// Nodes of one stage with the same state and reason share a row.
    ByStage,
    /// Nodes of one member of a suite with the same state share a row. It shows the reason of the first node.
    ByMember,
}

/// The rows of all nodes that are not up to date; with `verbose` the rows of all nodes.
fn rows(graph: &Graph, planned: &[Planned<'_>], verbose: bool) -> Vec<Vec<String>> {
    let shown: Vec<_> = planned.iter().filter(|it| verbose || !matches!(it.reason, Reason::Cached)).collect();
    let stages = shown.iter().map(|it| &it.node.stage).collect::<BTreeSet<_>>().len();
    let fold = match () {
        () if verbose || shown.len() <= ROWS => Fold::Nothing,
        () if graph.is_suite() && stages > ROWS => Fold::ByMember,
        () => Fold::ByStage,
    };
    let key = |it: &&Planned<'_>| {
        let (state, why) = state_and_reason(&it.reason, fold);
        match fold {
            Fold::Nothing => (it.node.name.clone(), state, why),
            Fold::ByStage => (it.node.stage.clone(), state, why),
            Fold::ByMember => (graph.members[it.node.member].name.clone(), state, String::new()),
        }
    };
    let row = |((group, state, _), own): ((String, String, String), Vec<&Planned<'_>>)| {
        let name = if own.len() > 1 { format!("{group} x{}", own.len()) } else { own[0].node.name.clone() };
        vec![name, state, state_and_reason(&own[0].reason, fold).1]
    };
    grouped(shown, key).into_iter().map(row).collect()
}

fn state_and_reason(reason: &Reason, fold: Fold) -> (String, String) {
    match reason {
        Reason::Cached => (out::dim("cached"), String::new()),
        // Nodes of one stage wait for different nodes, so a shared row leaves these out.
        Reason::Waiting { changes, .. } if fold != Fold::Nothing => {
            let changes: Vec<_> = changes.iter().map(ToString::to_string).collect();
            (out::dim("waiting"), changes.join(", "))
        }
        Reason::Waiting { .. } => (out::dim("waiting"), reason.to_string()),
        _ => (out::yellow("stale"), reason.to_string()),
    }
}
