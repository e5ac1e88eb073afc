//! `carl-pipe log` and `carl-pipe show`: the runs there are, and what one of them made.

use std::collections::BTreeMap;

use serde_json::json;

use super::{
    Global,
    exit::{Error, Exit},
    out::{self, Paint, duration},
};
use crate::{
    node_name::without_member,
    report::groups::grouped,
    run::{
        events::{NodeState, RunState},
        manifest::Manifest,
        node::NodeRecord,
        runs,
    },
    store::ResultStore,
};

/// The arguments of `log`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// How many.
    #[arg(short = 'n', long, value_name = "N", default_value_t = 20)]
    number: usize,
    /// One JSON object per run.
    #[arg(long)]
    json: bool,
}

/// The arguments of `show`.
#[derive(Debug, clap::Args)]
pub(crate) struct ShowArgs {
    /// The run: `latest`, its id, or the beginning of its id.
    #[arg(value_name = "RUN", default_value = "latest")]
    run: String,
    /// Only this stage or node, with its parameters and files.
    #[arg(value_name = "NODE")]
    node: Option<String>,
    /// The manifest.
    #[arg(long)]
    json: bool,
}

/// More nodes than this are shown by stage.
const ROWS: usize = 100;

/// Lists runs.
pub(crate) fn log(global: &Global, args: &Args) -> Result<Exit, Error> {
    let all = global.runs();
    let paint = global.color.on_stdout();
    let mut rows = Vec::new();
    for manifest in runs::manifests(&all).take(args.number) {
        let count = |state| manifest.nodes.iter().filter(|node| node.outcome.state == state).count();
        let (ran, cached) = (count(NodeState::Ran), count(NodeState::Cached));
        let state = state(&manifest, runs::is_alive(&all.join(&manifest.run)));
        if args.json {
            let object = json!({
                "version": 1, "run": manifest.run, "pipeline": manifest.pipeline, "started": manifest.started,
                "state": state, "executed": ran, "cached": cached, "nodes": manifest.nodes.len(),
                "wall_secs": manifest.wall_secs, "argv": manifest.argv,
            });
            out::line(&object.to_string());
        } else {
            rows.push(vec![
                manifest.run.clone(),
                manifest.pipeline.clone(),
                painted(state, paint),
                format!("{ran} ran, {cached} cached of {}", manifest.nodes.len()),
                duration(manifest.wall_secs),
            ]);
        }
    }
    if rows.is_empty() && !args.json {
        out::note(&format!("there are no runs in {} yet; start one with `carl-pipe run PIPELINE`", all.display()));
    }
    out::print(&out::table(&rows));
    Ok(Exit::Ok)
}

fn state(manifest: &Manifest, is_alive: bool) -> &'static str {
    match manifest.state {
        RunState::Running if is_alive => "running",
        RunState::Running => "killed",
        RunState::Finished => "finished",
        RunState::Failed => "failed",
        RunState::Interrupted => "interrupted",
    }
}

fn painted(state: &str, paint: Paint) -> String {
    match state {
        "finished" => paint.green(state),
        "failed" | "killed" => paint.red(state),
        _ => paint.yellow(state),
    }
}

/// Shows a run.
pub(crate) fn show(global: &Global, args: &ShowArgs) -> Result<Exit, Error> {
    let all = global.runs();
    let run_dir = runs::find(&all, &args.run).map_err(|error| Error::usage(error.to_string()))?;
    let manifest = Manifest::read(&run_dir)?;
    let is_named = |node: &NodeRecord, name: &str| {
        let member = &manifest.members[node.about.member].name;
        node.about.name == name
            || node.about.stage == name
            || without_member(&node.about.stage) == name
            || (!member.is_empty() && member == name)
    };
    let wanted = |node: &&NodeRecord| args.node.as_ref().is_none_or(|name| is_named(node, name));
    let nodes: Vec<&NodeRecord> = manifest.nodes.iter().filter(wanted).collect();
    if let (Some(name), []) = (&args.node, &nodes[..]) {
        return Err(Error::usage(format!("run {} has no stage or node `{name}`", manifest.run)));
    }
    if args.json {
        let value = if args.node.is_some() { json!(nodes) } else { json!(manifest) };
        out::line(&value.to_string());
        return Ok(Exit::Ok);
    }
    let paint = global.color.on_stdout();
    let state = state(&manifest, runs::is_alive(&run_dir));
    out::line(&format!("{} {}  {}", paint.bold(&manifest.pipeline), manifest.run, painted(state, paint)));
    out::line(&format!(
        "started {} on {} ({} cores), took {}, {:.2}% of node time in recorders",
        manifest.started,
        manifest.host.name,
        manifest.host.cores,
        duration(manifest.wall_secs),
        100.0 * manifest.recorder_secs / manifest.node_secs.max(1e-9)
    ));
    out::line(&format!("command: {}", out::command(&manifest.argv)));
    if let Some(commit) = &manifest.commit {
        out::line(&format!("carl-pipe {} of commit {commit}", manifest.carl_pipe));
    }
    let is_long = nodes.len() > ROWS && !global.verbose;
    let rows = if is_long { by_stage(&nodes) } else { nodes.iter().map(|node| row(node)).collect() };
    out::print(&out::table(&rows));
    if is_long {
        out::line(&paint.dim("every node: with -v, or name a stage or a member of a suite"));
    } else if args.node.is_some() {
        let store = global.store()?;
        for node in &nodes {
            out::line(&format!("\n{} {}", paint.bold(&node.about.name), node.about.work.params));
            out::print(&out::table(&files(&store, node)?));
        }
    }
    Ok(Exit::Ok)
}

/// A row for each stage, with how many of its nodes ended how.
fn by_stage(nodes: &[&NodeRecord]) -> Vec<Vec<String>> {
    let row = |(stage, own): &(&str, Vec<&NodeRecord>)| {
        let mut counts: BTreeMap<String, usize> = BTreeMap::new();
        own.iter().for_each(|node| *counts.entry(row(node).swap_remove(1)).or_default() += 1);
        let states: Vec<String> = counts.iter().map(|(state, count)| format!("{state} {count}")).collect();
        let secs = own.iter().map(|node| node.outcome.secs).sum();
        vec![format!("{stage} x{}", own.len()), states.join(", "), duration(secs)]
    };
    grouped(nodes.iter().copied(), |node| node.about.stage.as_str()).iter().map(row).collect()
}

fn row(node: &NodeRecord) -> Vec<String> {
    let state =
        serde_json::to_value(node.outcome.state).ok().and_then(|it| it.as_str().map(str::to_owned)).unwrap_or_default();
    let metrics = node.outcome.metrics.iter().map(|(name, value)| format!("{name} {}", out::number(*value)));
    let output = node.outcome.output.map_or_else(String::new, |digest| digest.short());
    vec![node.about.name.clone(), state, duration(node.outcome.secs), output, metrics.collect::<Vec<_>>().join(", ")]
}

/// Where the files and the recording of a node lie.
fn files(store: &dyn ResultStore, node: &NodeRecord) -> Result<Vec<Vec<String>>, Error> {
    let entry = node.outcome.key.map_or(Ok(None), |key| store.entry(key))?;
    let Some(entry) = entry.filter(|entry| Some(entry.output) == node.outcome.output) else {
        return Ok(vec![vec!["  what it made is gone".to_owned()]]);
    };
    let place = |object| store.path_of(object).map_or_else(String::new, |path| path.display().to_string());
    let row = |name: &str, object| vec![format!("  {name}"), place(object)];
    let files = entry.files.iter().map(|file| row(&file.name, file.object));
    Ok(files.chain(entry.recording.iter().map(|recording| row("recording", recording.object))).collect())
}
