//! The end of a run: a closing table, the headline, what went wrong, and what to look at next.

use std::path::Path;

use serde_json::{Map, Value, json};

use super::{
    Global,
    out::{self, duration},
    table,
};
use crate::{
    pipeline::Graph,
    report::{
        groups::grouped,
        headline::{Headline, headline},
        numbers::mean,
        outcomes::final_outcomes,
        series::{Series, pooled},
        table::{About, Grid, short},
    },
    run::{
        events::{NodeState, RunState},
        execute::{Failure, NodeReport, Report},
        runs::file_name,
    },
    stage::Kind,
    store::ResultStore,
};

/// With more nodes than this, the closing table has one row for each stage.
const ROWS: usize = 24;

/// A run that has ended, with what its summary is made from.
pub(crate) struct End<'a> {
    report: &'a Report,
    graph: &'a Graph,
    kinds: &'a [Kind],
    headline: Option<Headline>,
    /// The headline metric of the final results; empty where there are none.
    metric: &'static str,
    /// The final results, pooled over seeds.
    reached: Vec<Series>,
}

impl<'a> End<'a> {
    /// Reads what a run reached; nothing where the store cannot be read.
    pub(crate) fn of(report: &'a Report, graph: &'a Graph, store: &dyn ResultStore, kinds: &'a [Kind]) -> Self {
        let headline = headline(&report.manifest, kinds);
        let finals = final_outcomes(&report.manifest, kinds);
        let metric = finals.first().map_or("", |outcome| outcome.headline);
        let reached = pooled(finals, metric, true, store).unwrap_or_default();
        Self { report, graph, kinds, headline, metric, reached }
    }

    /// The last line of `--json`.
    pub(crate) fn json(&self) -> Value {
        let report = self.report;
        let node = |node: NodeReport<'_>| {
            let (outcome, error) = (&node.record.outcome, node.failure.map(Failure::text));
            json!({
                "state": outcome.state, "digest": outcome.output, "recording": outcome.recording,
                "secs": node.worked_secs, "figures": outcome.metrics, "error": error,
            })
        };
        let nodes: Map<String, Value> = report.nodes().map(|it| (it.record.about.name.clone(), node(it))).collect();
        let headline = self.headline;
        json!({
            "version": 1,
            "run": report.run,
            "state": report.state,
            "executed": report.count(NodeState::Ran),
            "cached": report.count(NodeState::Cached),
            "failed": report.count(NodeState::Failed),
            "wall_secs": report.wall_secs,
            "percent_goal": headline.filter(|it| it.metric == "percent_goal").map(|it| it.mean),
            "headline": headline.map(|it| json!({ "metric": it.metric, "mean": it.mean, "models": it.models })),
            "nodes": nodes,
        })
    }

    /// Prints the end of a run: tables to standard output, failures to standard error.
    pub(crate) fn print(&self, global: &Global, json: bool, argv: &[String]) {
        if !json {
            self.print_tables(global);
        }
        let report = self.report;
        for node in report.nodes().filter(|node| node.record.outcome.state == NodeState::Failed) {
            out::note(&self.failure(node));
        }
        if report.state == RunState::Interrupted {
            let (kept, all) = (self.kept(), report.ends.len());
            out::note(&format!("{} {kept} of {all} nodes are finished and kept", out::yellow("interrupted:")));
            out::note(&format!("  = {} continue with `{}`", out::bold("help:"), out::command(argv)));
        }
    }

    fn print_tables(&self, global: &Global) {
        let report = self.report;
        let ran_any = report.count(NodeState::Cached) < report.ends.len();
        if (ran_any && !global.quiet) || global.verbose {
            out::print(&out::table(&self.rows()));
        }
        match self.grid() {
            Some(grid) => out::line(&format!("\n{grid}\n{}", self.closing(None))),
            None => out::line(&self.closing(self.headline_text().as_deref())),
        }
        if !global.quiet {
            let elsewhere = global.artifacts != Path::new("artifacts") && std::env::var_os("CARL_ARTIFACTS").is_none();
            let folder = if elsewhere { format!(" --artifacts {}", global.artifacts.display()) } else { String::new() };
            let verbs = ["view", "plot"].map(|verb| format!("carl-pipe {verb} {}{folder}", report.run));
            out::line(&out::dim(&format!("look: {}  or  {}/", verbs.join("  or  "), report.path.display())));
        }
    }

    /// The table of a suite: tasks by algorithms. `None` for a single series.
    fn grid(&self) -> Option<String> {
        let metric = self.metric;
        if self.reached.len() < 2 {
            return None;
        }
        let grid = Grid::new(self.reached.clone(), "task", "algorithm").ok()?;
        let rows = table::text(short(&grid, About { metric, rows: "task", cols: "algorithm" }));
        Some(format!("{}\n{rows}", out::dim(&format!("{metric}: mean ± standard error (models)"))))
    }

    /// The headline for the closing line, with its standard error where there are several models.
    fn headline_text(&self) -> Option<String> {
        match &self.reached[..] {
            [one] if one.values.len() > 1 => Some(format!("{} {}", self.metric, mean(one.estimate()))),
            _ => self.headline.map(|it| format!("{} {}", it.metric, out::number(it.mean))),
        }
    }

    /// A row for each node, or for each stage of a large run, or for each member of a large suite.
    fn rows(&self) -> Vec<Vec<String>> {
        if self.report.ends.len() <= ROWS {
            let row = |node: NodeReport<'_>| {
                vec![
                    node.record.about.name.clone(),
                    coloured(node.record.outcome.state),
                    time(node.worked_secs),
                    self.metric_of(node),
                ]
            };
            return self.report.nodes().map(row).collect();
        }
        let is_suite = self.graph.is_suite();
        let name = |node: &NodeReport<'_>| {
            let about = &node.record.about;
            if is_suite { self.graph.members[about.member].name.clone() } else { about.stage.clone() }
        };
        grouped(self.report.nodes(), name).iter().map(|(name, nodes)| self.group_row(name, nodes, is_suite)).collect()
    }

    fn group_row(&self, name: &str, nodes: &[NodeReport<'_>], is_member: bool) -> Vec<String> {
        let count = |state| nodes.iter().filter(|node| node.record.outcome.state == state).count();
        let counts = STATES.iter().map(|it| (it, count(*it))).filter(|(_, count)| *count > 0);
        let states: Vec<String> = counts.map(|(it, count)| format!("{} {count}", coloured(*it))).collect();
        let last = nodes.iter().rev().find(|node| !node.record.outcome.metrics.is_empty() && !is_member);
        let metric = last.map_or_else(String::new, |node| self.metric_of(*node));
        let secs: f64 = nodes.iter().map(|node| node.worked_secs).sum();
        vec![format!("{name} x{}", nodes.len()), states.join(", "), time(secs), metric]
    }

    /// A headline metric where the node has one, else its first metric.
    fn metric_of(&self, node: NodeReport<'_>) -> String {
        let mut headlines = self.kinds.iter().filter_map(|kind| kind.headline);
        let first = headlines.find_map(|name| node.record.outcome.metrics.get_key_value(name));
        let first = first.or_else(|| node.record.outcome.metrics.first_key_value());
        first.map_or_else(String::new, |(name, value)| format!("{name} {}", out::number(*value)))
    }

    /// `12 ran, 3 cached in 4.1 s; percent_goal 76.8`
    fn closing(&self, headline: Option<&str>) -> String {
        let report = self.report;
        let counts = STATES.iter().map(|it| (it, report.count(*it))).filter(|(_, count)| *count > 0);
        let parts: Vec<String> = counts.map(|(it, count)| format!("{count} {}", word(*it))).collect();
        let headline = headline.map_or_else(String::new, |text| format!("; {text}"));
        let time = duration(report.wall_secs);
        out::bold(&format!("{} in {time}{headline}", parts.join(", ")))
    }

    fn failure(&self, node: NodeReport<'_>) -> String {
        let text = node.failure.map_or_else(String::new, |failure| out::tidy(failure.text()));
        let kind = self.graph.nodes.iter().find(|it| it.name == node.record.about.name).map_or("", |it| it.kind.name);
        let mut lines = vec![format!("{} {} ({kind}) failed: {text}", out::red("error:"), node.record.about.name)];
        let recording = self.report.path.join("live").join(format!("{}.mcap", file_name(&node.record.about.name)));
        if recording.exists() {
            lines.push(format!("  = its recording until the failure: {}", recording.display()));
        }
        let (help, kept) = (out::bold("help:"), self.kept());
        lines.push(format!("  = {help} {kept} finished nodes are kept; the same command continues from there"));
        lines.join("\n")
    }

    fn kept(&self) -> usize {
        self.report.count(NodeState::Ran) + self.report.count(NodeState::Cached)
    }
}

/// How nodes may end, in the order in which they are counted.
const STATES: [NodeState; 5] =
    [NodeState::Ran, NodeState::Cached, NodeState::Failed, NodeState::Stopped, NodeState::Pending];

fn word(state: NodeState) -> &'static str {
    match state {
        NodeState::Ran => "ran",
        NodeState::Cached => "cached",
        NodeState::Failed => "failed",
        NodeState::Stopped => "stopped",
        NodeState::Pending => "not run",
    }
}

fn coloured(state: NodeState) -> String {
    let colour = match state {
        NodeState::Ran => out::green,
        NodeState::Cached => out::dim,
        NodeState::Failed => out::red,
        NodeState::Stopped | NodeState::Pending => out::yellow,
    };
    colour(word(state))
}

fn time(secs: f64) -> String {
    if secs > 0.0 { duration(secs) } else { String::new() }
}
