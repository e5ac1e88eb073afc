//! What a run would do: each node has its output in the store, has to run, or waits for nodes that have to run.
//!
//! Planning writes nothing. It only sets damaged files of the store aside.

use std::collections::BTreeSet;

use super::key;
use crate::{
    digest::Digest,
    pipeline::{Graph, NodeId},
    store::{Entry, Key, Lookup, ResultStore},
};

/// What a run would do with a node.
#[derive(Debug)]
pub enum State {
    /// Nothing: the store has its output.
    Hit(Key, Box<Entry>),
    /// Run it.
    Stale(Key, Cause),
    /// Wait for these nodes. Its key is not known before they have run.
    Waiting(Vec<NodeId>),
}

/// Why the store has no output that a node could use.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Cause {
    /// The store has none for this key.
    Missing,
    /// The one that the store has cannot be used, for this reason.
    Unusable(String),
    /// The user wants a new one.
    Forced,
}

/// Which nodes run although the store has their output.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum Force {
    /// No node.
    #[default]
    None,
    /// All wanted nodes.
    All,
    /// The nodes with these names, or of these stages.
    Named(BTreeSet<String>),
    /// The nodes whose recording is missing.
    Unrecorded,
}

/// Which results of the store a node takes instead of running.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Takes {
    /// Any whole output.
    Any,
    /// A whole output with its recording.
    Recorded,
    /// None.
    Nothing,
}

impl Force {
    /// Which results of the store a node takes.
    pub(super) fn takes(&self, graph: &Graph, id: NodeId) -> Takes {
        match self {
            Self::All => Takes::Nothing,
            Self::Named(names) if names.iter().any(|name| graph.is_named(id, name)) => Takes::Nothing,
            Self::Unrecorded => Takes::Recorded,
            Self::None | Self::Named(_) => Takes::Any,
        }
    }
}

/// The state of every wanted node; `None` for the others.
pub type Plan = Vec<Option<State>>;

/// Looks up every wanted node.
///
/// # Errors
/// The store failed.
pub fn plan(graph: &Graph, wanted: &[bool], store: &dyn ResultStore, force: &Force) -> anyhow::Result<Plan> {
    let mut plan: Plan = Vec::with_capacity(graph.nodes.len());
    for (id, node) in graph.nodes.iter().enumerate() {
        let state = if !wanted[id] {
            None
        } else if let Some(key) = key::of_node(node, |source| output(&plan, source)) {
            Some(match look_up(key.digest, force.takes(graph, id), store)? {
                LookedUp::Hit(entry) => State::Hit(key, entry),
                LookedUp::Stale(cause) => State::Stale(key, cause),
            })
        } else {
            let waits_for = node.inputs.iter().flat_map(|(_, sources)| sources).copied();
            Some(State::Waiting(waits_for.filter(|&source| output(&plan, source).is_none()).collect()))
        };
        plan.push(state);
    }
    Ok(plan)
}

/// What a look-up says about a key.
#[derive(Debug)]
pub(super) enum LookedUp {
    /// The store has its output.
    Hit(Box<Entry>),
    /// Its output has to be made.
    Stale(Cause),
}

/// Looks up one key.
pub(super) fn look_up(key: Digest, takes: Takes, store: &dyn ResultStore) -> anyhow::Result<LookedUp> {
    if takes == Takes::Nothing {
        return Ok(LookedUp::Stale(Cause::Forced));
    }
    Ok(match store.find(key)? {
        Lookup::Hit(entry) if takes == Takes::Recorded && entry.recording.is_none() => {
            LookedUp::Stale(Cause::Unusable("its recording is gone".to_owned()))
        }
        Lookup::Hit(entry) => LookedUp::Hit(entry),
        Lookup::Miss => LookedUp::Stale(Cause::Missing),
        Lookup::Unusable(why) => LookedUp::Stale(Cause::Unusable(why)),
    })
}

fn output(plan: &Plan, source: NodeId) -> Option<Digest> {
    match plan.get(source)? {
        Some(State::Hit(_, entry)) => Some(entry.output),
        _ => None,
    }
}

/// The nodes that targets name (see [`Graph::is_named`]), and all nodes that they need; every node if there are no
/// targets.
///
/// # Errors
/// The first target that names neither a stage nor a node.
pub fn select(graph: &Graph, targets: &[String]) -> Result<Vec<bool>, String> {
    let mut wanted = vec![targets.is_empty(); graph.nodes.len()];
    for target in targets {
        let mut is_known = false;
        for id in (0..graph.nodes.len()).filter(|&id| graph.is_named(id, target)) {
            (wanted[id], is_known) = (true, true);
        }
        if !is_known {
            return Err(target.clone());
        }
    }
    for id in (0..graph.nodes.len()).rev().filter(|_| !targets.is_empty()) {
        if wanted[id] {
            graph.nodes[id].inputs.iter().flat_map(|(_, sources)| sources).for_each(|&source| wanted[source] = true);
        }
    }
    Ok(wanted)
}
