//! Makes again what a run used and the store has no more: outputs and recordings, from the manifest alone.

use std::path::Path;

use super::{
    execute::{self, Options, Order},
    manifest::Manifest,
    node::NodeRecord,
    plan::Force,
    runs,
};
use crate::{
    pipeline::Graph,
    stage::Kind,
    store::{LocalStore, Lookup, ResultStore as _},
};

/// What a repair did for a run.
#[derive(Debug, Default, Clone, PartialEq, Eq)]
pub struct Repaired {
    /// The names of the nodes whose output and recording are whole again.
    pub made: Vec<String>,
    /// The names of the nodes that are not, and why.
    pub left: Vec<(String, String)>,
}

/// Runs every node of a run again whose output or recording is not whole, with its recorded inputs. `scratch` is a folder
/// for what the repair writes besides results; the caller removes it.
///
/// # Errors
/// The store or the system failed.
pub fn repair(
    manifest: &Manifest,
    store: &LocalStore,
    scratch: &Path,
    options: &Options,
    kind: &dyn Fn(&str) -> Option<&'static Kind>,
    listener: &dyn super::events::Listener,
) -> anyhow::Result<Repaired> {
    let broken: Vec<&NodeRecord> = manifest.nodes.iter().filter(|record| !is_whole(record, store)).collect();
    let mut repaired = Repaired::default();
    if broken.is_empty() {
        return Ok(repaired);
    }
    let graph = match manifest.graph(kind) {
        Ok(graph) => graph,
        Err(error) => {
            repaired.left = broken.iter().map(|it| (it.about.name.clone(), error.to_string())).collect();
            return Ok(repaired);
        }
    };
    let wanted = with_inputs(&graph, manifest.nodes.iter().map(|record| !is_whole(record, store)).collect());
    let order = Order { graph: &graph, wanted, text: &manifest.text, argv: manifest.argv.clone(), note: None };
    let options = Options { force: Force::Unrecorded, keep_going: true, ..options.clone() };
    let report = execute::run(store, &runs::folder(scratch), &order, &options, listener)?;
    for old in broken {
        let name = old.about.name.clone();
        let Some(new) = report.node(&name) else { continue };
        let why = match (old.outcome.output, new.record.outcome.output) {
            _ if is_whole(old, store) => {
                repaired.made.push(name);
                continue;
            }
            (Some(old), Some(new)) if old != new => {
                format!("its output came out otherwise: it was {}, now {}", old.short(), new.short())
            }
            (_, Some(_)) => "its recording failed again".to_owned(),
            (_, None) => new.failure.map_or("it did not run", |failure| failure.text()).to_owned(),
        };
        repaired.left.push((name, why));
    }
    Ok(repaired)
}

/// Whether the store has the output of a node, the same as in the run, and its recording. True for a node that the run
/// did not finish: nothing was promised of it.
fn is_whole(record: &NodeRecord, store: &LocalStore) -> bool {
    let (Some(key), Some(output)) = (record.outcome.key, record.outcome.output) else { return true };
    match store.find(key) {
        Ok(Lookup::Hit(entry)) => entry.output == output && entry.recording.is_some(),
        _ => false,
    }
}

/// The wanted nodes and all that they need.
fn with_inputs(graph: &Graph, mut wanted: Vec<bool>) -> Vec<bool> {
    for id in (0..graph.nodes.len()).rev() {
        if wanted[id] {
            graph.nodes[id].inputs.iter().flat_map(|(_, sources)| sources).for_each(|&source| wanted[source] = true);
        }
    }
    wanted
}
