//! `carl-pipe show`: prints the results of a run.

use std::collections::BTreeMap;

use serde_json::json;

use super::{
    Global,
    exit::{Error, Exit},
    log::coloured,
    out::{self, duration},
};
use crate::{
    node_name::without_member,
    report::groups::grouped,
    run::{holdings::Standing, manifest::Manifest, node::NodeRecord},
    store::ResultStore,
};

/// The arguments of `show`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The run: `latest`, `latest~1`, a tag, a pipeline (its newest run), a run id, or the beginning of an id.
    #[arg(value_name = "RUN", default_value = "latest")]
    run: String,
    /// Show only this stage or node, with its parameters and files.
    #[arg(value_name = "NODE")]
    node: Option<String>,
    /// Print the manifest as JSON.
    #[arg(long)]
    json: bool,
}

/// With more nodes than this, the table has one row for each stage.
const ROWS: usize = 100;

/// Shows a run.
pub(crate) fn show(global: &Global, args: &Args) -> Result<Exit, Error> {
    let manifest = global.manifest(&args.run)?;
    let nodes = named(&manifest, args.node.as_deref())?;
    if args.json {
        out::json(&if args.node.is_some() { json!(nodes) } else { json!(manifest) });
        return Ok(Exit::Ok);
    }
    let run_dir = global.runs().join(&manifest.run);
    print_head(&manifest, Standing::of(&run_dir, Some(manifest.state)));
    if nodes.len() > ROWS && !global.verbose {
        out::print(&out::table(&by_stage(&nodes)));
        out::line(&out::dim("to list every node, add -v or name a stage or a member of a suite"));
        return Ok(Exit::Ok);
    }
    out::print(&out::table(&nodes.iter().map(|node| row(node)).collect::<Vec<_>>()));
    if args.node.is_some() {
        let store = global.store_to_read()?;
        for node in &nodes {
            out::line(&format!("\n{} {}", out::bold(&node.about.name), node.about.work.params));
            out::print(&out::table(&files(&store, node)?));
        }
    }
    Ok(Exit::Ok)
}

/// The nodes with this name: of a node, of a stage or of a member of a suite. All nodes if there is no name.
fn named<'a>(manifest: &'a Manifest, name: Option<&str>) -> Result<Vec<&'a NodeRecord>, Error> {
    let Some(name) = name else { return Ok(manifest.nodes.iter().collect()) };
    let is_named = |node: &&NodeRecord| {
        let member = &manifest.members[node.about.member].name;
        node.about.name == name
            || node.about.stage == name
            || without_member(&node.about.stage) == name
            || (!member.is_empty() && member == name)
    };
    let nodes: Vec<&NodeRecord> = manifest.nodes.iter().filter(is_named).collect();
    if nodes.is_empty() {
        return Err(Error::usage(format!("run {} has no stage or node `{name}`", manifest.run)));
    }
    Ok(nodes)
}

/// Prints what is known of a run as a whole.
fn print_head(manifest: &Manifest, standing: Standing) {
    out::line(&format!("{} {}  {}", out::bold(&manifest.pipeline), manifest.run, coloured(standing)));
    out::line(&format!(
        "started {} on {} ({} cores), took {}, recording took {:.2}% of the nodes' time",
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
}

/// A row for each stage, with the number of its nodes in each state.
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

/// Name, state, time, output and metrics of a node.
fn row(node: &NodeRecord) -> Vec<String> {
    let state =
        serde_json::to_value(node.outcome.state).ok().and_then(|it| it.as_str().map(str::to_owned)).unwrap_or_default();
    let metrics = node.outcome.metrics.iter().map(|(name, value)| format!("{name} {}", out::number(*value)));
    let output = node.outcome.output.map_or_else(String::new, |digest| digest.short());
    vec![node.about.name.clone(), state, duration(node.outcome.secs), output, metrics.collect::<Vec<_>>().join(", ")]
}

/// The paths of the files and of the recording of a node.
fn files(store: &dyn ResultStore, node: &NodeRecord) -> Result<Vec<Vec<String>>, Error> {
    let entry = node.outcome.key.map_or(Ok(None), |key| store.entry(key))?;
    let Some(entry) = entry.filter(|entry| Some(entry.output) == node.outcome.output) else {
        return Ok(vec![vec!["  its output is no longer in the store".to_owned()]]);
    };
    let path = |object| store.path_of(object).map_or_else(String::new, |path| path.display().to_string());
    let row = |name: &str, object| vec![format!("  {name}"), path(object)];
    let files = entry.files.iter().map(|file| row(&file.name, file.object));
    Ok(files.chain(entry.recording.iter().map(|recording| row("recording", recording.object))).collect())
}
