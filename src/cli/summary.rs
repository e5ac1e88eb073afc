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
    report::{
        headline::{Headline, headline},
        outcomes::{Outcome, outcomes},
    },
    run::{
        events::{NodeState, RunState},
        execute::{NodeReport, Report},
        manifest::Manifest,
    },
    stage::Kind,
    store::Store,
};

/// More nodes than this are shown by stage.
const ROWS: usize = 24;

/// The last line of `--json`.
pub(crate) fn json(report: &Report, headline: Option<Headline>) -> Value {
    let node = |node: &NodeReport| {
        let error = node.failure.as_ref().map(|failure| &failure.text);
        json!({
            "state": node.state, "digest": node.digest, "recording": node.recording, "secs": node.secs,
            "figures": node.metrics, "error": error,
        })
    };
    let nodes: Map<String, Value> = report.nodes.iter().map(|it| (it.name.clone(), node(it))).collect();
    let percent_goal = headline.filter(|it| it.metric == "percent_goal").map(|it| it.mean);
    let headline = headline.map(|it| json!({ "metric": it.metric, "mean": it.mean, "models": it.models }));
    json!({
        "version": 1,
        "run": report.run,
        "state": report.state,
        "executed": report.count(NodeState::Ran),
        "cached": report.count(NodeState::Cached),
        "failed": report.count(NodeState::Failed),
        "wall_secs": report.wall_secs,
        "percent_goal": percent_goal,
        "headline": headline,
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
            out::print(&table(report, graph, end.kinds, paint));
        }
        let (metric, reached) = end.reached();
        if reached.len() > 1
            && let Ok(grid) = Grid::new(reached, "task", "algorithm")
        {
            let about = About { metric, rows: "task", cols: "algorithm" };
            out::line(&format!("\n{}", paint.dim(&format!("{metric}: mean ± standard error (models)"))));
            out::line(&render::short(&grid, about, Format::Text, paint));
            out::line(&closing(report, None, paint));
        } else {
            out::line(&closing(report, end.headline_text().as_deref(), paint));
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
    graph: &'a Graph,
    store: &'a Store,
    kinds: &'a [Kind],
    /// `None` where it cannot be read.
    manifest: Option<Manifest>,
}

impl<'a> End<'a> {
    /// Reads the manifest of a run that has ended.
    pub(crate) fn of(report: &Report, graph: &'a Graph, store: &'a Store, kinds: &'a [Kind]) -> Self {
        Self { graph, store, kinds, manifest: Manifest::read(&report.path).ok() }
    }

    /// See [`headline`].
    pub(crate) fn headline(&self) -> Option<Headline> {
        headline(self.manifest.as_ref()?, self.kinds)
    }

    /// The headline metric of the final results, and the final results pooled over seeds.
    fn reached(&self) -> (&'static str, Vec<Series>) {
        let all = self.manifest.as_ref().map_or_else(Vec::new, |manifest| outcomes(manifest, self.kinds));
        let finals: Vec<Outcome> = all.into_iter().filter(|outcome| outcome.is_last).collect();
        let metric = finals.first().map_or("", |outcome| outcome.headline);
        (metric, table::series::pooled(finals, metric, true, self.store).unwrap_or_default())
    }

    /// The headline for the closing line, with its standard error where there are several models.
    fn headline_text(&self) -> Option<String> {
        let (metric, reached) = self.reached();
        match &reached[..] {
            [one] if one.summary.n > 1 => Some(format!("{metric} {}", render::mean(&one.summary))),
            _ => self.headline().map(|it| format!("{} {}", it.metric, out::number(it.mean))),
        }
    }
}

fn table(report: &Report, graph: &Graph, kinds: &[Kind], paint: Paint) -> String {
    let mut rows = Vec::new();
    if report.nodes.len() <= ROWS {
        rows.extend(
            report
                .nodes
                .iter()
                .map(|node| vec![node.name.clone(), state(node.state, paint), time(node.secs), metric(node, kinds)]),
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
        rows.extend(groups.iter().map(|(name, nodes)| group_row(name, nodes, graph.is_suite(), kinds, paint)));
    }
    out::table(&rows)
}

fn group_row(name: &str, nodes: &[&NodeReport], is_member: bool, kinds: &[Kind], paint: Paint) -> Vec<String> {
    let mut counts: BTreeMap<u8, (NodeState, usize)> = BTreeMap::new();
    for node in nodes {
        counts.entry(node.state as u8).or_insert((node.state, 0)).1 += 1;
    }
    let states = counts.values().map(|(it, count)| format!("{} {count}", state(*it, paint)));
    let last = nodes.iter().rev().find(|node| !node.metrics.is_empty() && !is_member);
    let metric = last.map_or_else(String::new, |node| metric(node, kinds));
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

/// A headline metric where there is one, else the first metric.
fn metric(node: &NodeReport, kinds: &[Kind]) -> String {
    let mut headlines = kinds.iter().filter_map(|kind| kind.headline);
    let first = headlines.find_map(|name| node.metrics.get_key_value(name)).or_else(|| node.metrics.first_key_value());
    first.map_or_else(String::new, |(name, value)| format!("{name} {}", out::number(*value)))
}

fn closing(report: &Report, headline: Option<&str>, paint: Paint) -> String {
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
    let metric = headline.map_or_else(String::new, |text| format!("; {text}"));
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
