//! What became of a run: a closing table, what went wrong, and where to look next.

use std::{collections::BTreeMap, path::Path};

use serde_json::{Map, Value, json};

use super::{
    Global,
    out::{self, Paint, duration},
    table::{self, Format, grid::Grid, render, render::About, series::Series},
};
use crate::{
    pipeline::Graph,
    run::{
        events::{NodeState, RunState},
        execute::{NodeReport, Report},
    },
    stage::Kind,
    store::Store,
};

/// More nodes than this are shown by stage.
const ROWS: usize = 24;

/// The last line of `--json`.
pub(crate) fn json(report: &Report) -> Value {
    let node = |node: &NodeReport| {
        let error = node.failure.as_ref().map(|failure| &failure.text);
        json!({
            "state": node.state, "digest": node.digest, "recording": node.recording, "secs": node.secs,
            "figures": node.metrics, "error": error,
        })
    };
    let nodes: Map<String, Value> = report.nodes.iter().map(|it| (it.name.clone(), node(it))).collect();
    json!({
        "version": 1,
        "run": report.run,
        "state": report.state,
        "executed": report.count(NodeState::Ran),
        "cached": report.count(NodeState::Cached),
        "failed": report.count(NodeState::Failed),
        "wall_secs": report.wall_secs,
        "percent_goal": report.percent_goal,
        "nodes": nodes,
    })
}

/// Prints the end of a run: the table to standard output, failures to standard error.
pub(crate) fn print(report: &Report, end: &End<'_>, global: &Global, json: bool, argv: &[String]) {
    let graph = end.graph;
    if !json {
        let paint = global.color.on_stdout();
        let ran_any = report.nodes.iter().any(|node| node.state != NodeState::Cached);
        if (ran_any && !global.quiet) || global.verbose {
            out::print(&table(report, graph, paint));
        }
        let reached = end.reached(report);
        if reached.len() > 1
            && let Ok(grid) = Grid::new(reached, "task", "algorithm")
        {
            let about = About { metric: "percent_goal", rows: "task", cols: "algorithm" };
            out::line(&format!("\n{}", paint.dim("percent_goal: mean ± standard error (models)")));
            out::line(&render::short(&grid, about, Format::Text, paint));
            out::line(&closing(report, &[], paint));
        } else {
            out::line(&closing(report, &end.reached(report), paint));
        }
        if !global.quiet {
            let elsewhere = global.artifacts != Path::new("artifacts") && std::env::var_os("CARL_ARTIFACTS").is_none();
            let folder = if elsewhere { format!(" --artifacts {}", global.artifacts.display()) } else { String::new() };
            let view = format!("carl-pipe view {}{folder}", report.run);
            out::line(&paint.dim(&format!("look: {view}  or  {}/", report.path.display())));
        }
    }
    let paint = global.color.on_stderr();
    for node in report.nodes.iter().filter(|node| node.state == NodeState::Failed) {
        out::note(&failure(node, report, graph, paint));
    }
    if report.state == RunState::Interrupted {
        let kept = report.count(NodeState::Ran) + report.count(NodeState::Cached);
        out::note(&format!(
            "{} {kept} of {} nodes are finished and kept",
            paint.yellow("interrupted:"),
            report.nodes.len()
        ));
        out::note(&format!("  = {} go on with `{}`", paint.bold("help:"), out::command(argv)));
    }
}

/// What the end of a run is told from.
pub(crate) struct End<'a> {
    pub(crate) graph: &'a Graph,
    pub(crate) store: &'a Store,
    pub(crate) kinds: &'a [Kind],
}

impl End<'_> {
    /// What the final evaluations reached; nothing where the manifest cannot be read.
    fn reached(&self, report: &Report) -> Vec<Series> {
        let all = table::all_outcomes(self.store, std::slice::from_ref(&report.run), self.kinds);
        let finals = all.unwrap_or_default().into_iter().filter(|outcome| outcome.is_last).collect();
        table::series::pooled(finals, "percent_goal", true, self.store).unwrap_or_default()
    }
}

fn table(report: &Report, graph: &Graph, paint: Paint) -> String {
    let mut rows = Vec::new();
    if report.nodes.len() <= ROWS {
        rows.extend(
            report
                .nodes
                .iter()
                .map(|node| vec![node.name.clone(), state(node.state, paint), time(node.secs), headline(node)]),
        );
    } else {
        let mut groups: Vec<(&str, Vec<&NodeReport>)> = Vec::new();
        for node in &report.nodes {
            // A suite is shown by its members.
            let stage = node.stage.as_str();
            let name = if graph.is_suite() { stage.split('/').next().unwrap_or(stage) } else { stage };
            match groups.iter_mut().find(|(known, _)| *known == name) {
                Some((_, nodes)) => nodes.push(node),
                None => groups.push((name, vec![node])),
            }
        }
        rows.extend(groups.iter().map(|(name, nodes)| group_row(name, nodes, graph.is_suite(), paint)));
    }
    out::table(&rows)
}

fn group_row(name: &str, nodes: &[&NodeReport], is_member: bool, paint: Paint) -> Vec<String> {
    let mut counts: BTreeMap<u8, (NodeState, usize)> = BTreeMap::new();
    for node in nodes {
        counts.entry(node.state as u8).or_insert((node.state, 0)).1 += 1;
    }
    let states = counts.values().map(|(it, count)| format!("{} {count}", state(*it, paint)));
    let last = nodes.iter().rev().find(|node| !node.metrics.is_empty() && !is_member);
    let metric = last.map_or_else(String::new, |node| headline(node));
    let secs: f64 = nodes.iter().map(|node| node.secs).sum();
    vec![format!("{name} x{}", nodes.len()), states.collect::<Vec<_>>().join(", "), time(secs), metric]
}

fn state(state: NodeState, paint: Paint) -> String {
    match state {
        NodeState::Ran => paint.green("ran"),
        NodeState::Cached => paint.dim("cached"),
        NodeState::Failed => paint.red("failed"),
        NodeState::Stopped => paint.yellow("stopped"),
        NodeState::Pending => paint.yellow("not run"),
    }
}

fn time(secs: f64) -> String {
    if secs > 0.0 { duration(secs) } else { String::new() }
}

/// `percent_goal` where there is one, else the first metric.
fn headline(node: &NodeReport) -> String {
    let first = node.metrics.get_key_value("percent_goal").or_else(|| node.metrics.first_key_value());
    first.map_or_else(String::new, |(name, value)| format!("{name} {}", out::number(*value)))
}

fn closing(report: &Report, reached: &[Series], paint: Paint) -> String {
    let mut parts = Vec::new();
    let all = [
        (NodeState::Ran, "ran"),
        (NodeState::Cached, "cached"),
        (NodeState::Failed, "failed"),
        (NodeState::Stopped, "stopped"),
        (NodeState::Pending, "not run"),
    ];
    for (state, word) in all {
        let count = report.count(state);
        if count > 0 {
            parts.push(format!("{count} {word}"));
        }
    }
    let metric = match reached {
        [one] if one.summary.n > 1 => format!("; percent_goal {}", render::mean(&one.summary)),
        _ => report.percent_goal.map_or_else(String::new, |value| format!("; percent_goal {}", out::number(value))),
    };
    format!("{}{}", paint.bold(&format!("{} in {}", parts.join(", "), duration(report.wall_secs))), paint.bold(&metric))
}

fn failure(node: &NodeReport, report: &Report, graph: &Graph, paint: Paint) -> String {
    let text = node.failure.as_ref().map_or_else(String::new, |failure| out::tidy(&failure.text));
    let kind = graph.nodes.iter().find(|it| it.name == node.name).map_or("", |it| it.kind.name);
    let mut lines = vec![format!("{} {} ({kind}) failed: {text}", paint.red("error:"), node.name)];
    let recording = report.path.join("live").join(format!("{}.mcap", crate::run::runs::file_name(&node.name)));
    if recording.exists() {
        lines.push(format!("  = what it recorded until then: {}", recording.display()));
    }
    let kept = report.count(NodeState::Ran) + report.count(NodeState::Cached);
    lines.push(format!(
        "  = {} {kept} finished nodes are kept; the same command goes on from there",
        paint.bold("help:")
    ));
    lines.join("\n")
}
