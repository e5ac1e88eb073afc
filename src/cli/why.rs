//! `carl-pipe why`: shows what changed for a node since it last ran, with old and new values.

use serde_json::json;

use super::{
    Global,
    exit::{Error, Exit},
    file::{self, PipelineArgs},
    out::{self, duration},
};
use crate::{
    pipeline::{Graph, NodeId},
    run::{
        changes::Change,
        plan::{Force, Plan, State, plan},
        why::{History, Reason, reason},
    },
    stage::Kind,
};

/// The arguments of `why`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    file: PipelineArgs,
    /// A node such as `represent@3`, or a stage: then all of its nodes.
    #[arg(value_name = "NODE")]
    node: String,
    /// Print one JSON object for each node.
    #[arg(long)]
    json: bool,
}

/// Explains why nodes are stale or up to date.
pub(crate) fn why(global: &Global, args: &Args, kinds: &'static [Kind]) -> Result<Exit, Error> {
    let loaded = file::load(&args.file.pipeline, &args.file.changes, kinds, args.json)?;
    let graph = &loaded.graph;
    let wanted = file::pick(graph, std::slice::from_ref(&args.node))?;
    let store = global.store_to_read()?;
    let plan = plan(graph, &wanted, &store, &Force::None)?;
    let mut history = History::new(&global.runs());
    let named = (0..graph.nodes.len()).filter(|&id| graph.is_named(id, &args.node));
    for id in named {
        let Some(reason) = reason(graph, &plan, id, &mut history) else { continue };
        if args.json {
            let key = match &plan[id] {
                Some(State::Hit(key, _) | State::Stale(key, _)) => json!({"digest": key.digest, "key": key.json}),
                _ => json!(null),
            };
            let name = &graph.nodes[id].name;
            out::json(&json!({"version": 1, "node": name, "reason": reason, "key": key}));
        } else {
            out::print(&explanation(graph, &plan, id, &reason, global.verbose));
        }
    }
    Ok(Exit::Ok)
}

/// Why a node is stale or up to date; `verbose` adds its key.
fn explanation(graph: &Graph, plan: &Plan, id: NodeId, reason: &Reason, verbose: bool) -> String {
    let name = out::bold(&graph.nodes[id].name);
    let changed =
        |changes: &[Change]| -> String { changes.iter().map(|change| format!("{name}: {change}\n")).collect() };
    let mut text = match reason {
        Reason::Cached => match &plan[id] {
            Some(State::Hit(key, entry)) => format!(
                "{name} is up to date: run {} made it in {}, key {}\n",
                entry.run,
                duration(entry.secs),
                key.digest.short()
            ),
            _ => format!("{name} is up to date\n"),
        },
        Reason::Changed { changes, since } => {
            format!("{}{}\n", changed(changes), out::dim(&format!("  since run {since}")))
        }
        Reason::Waiting { on, changes } => {
            format!("{}{name}: needs the new output of {}\n", changed(changes), on.join(", "))
        }
        other => format!("{name}: {other}\n"),
    };
    if verbose && let Some(State::Hit(key, _) | State::Stale(key, _)) = &plan[id] {
        text.push_str(&serde_json::to_string_pretty(&key.json).unwrap_or_default());
        text.push('\n');
    }
    text
}
