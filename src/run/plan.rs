//! What a run would do: each node is a hit, stale with its reason, or waiting for inputs that do not exist yet.
//!
//! Planning writes nothing but what it finds damaged, which it puts aside.

use std::collections::BTreeSet;

use super::key::Key;
use crate::store::{Entry, Found, Store};
use crate::{
    digest::Digest,
    pipeline::{Graph, NodeId},
};

/// What a node needs.
#[derive(Debug)]
pub enum State {
    /// Nothing: the store has its output.
    Hit(Key, Box<Entry>),
    /// To run.
    Stale(Key, Cause),
    /// Its key is not known until these nodes have run.
    Waiting(Vec<NodeId>),
}

/// Why the store has no output to use.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Cause {
    /// It never had one for this key.
    Missing,
    /// What it has cannot be used.
    Unusable(String),
    /// The user wants it again.
    Forced,
}

/// Which nodes run although the store has their output.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum Force {
    /// None.
    #[default]
    None,
    /// All that are wanted.
    All,
    /// Those of these stages, or with these names.
    Named(BTreeSet<String>),
}

impl Force {
    /// Whether a node is forced.
    pub fn has(&self, graph: &Graph, id: NodeId) -> bool {
        match self {
            Self::None => false,
            Self::All => true,
            Self::Named(names) => names.iter().any(|name| graph.is_named(id, name)),
        }
    }
}

/// The state of every wanted node; `None` for the others.
pub type Plan = Vec<Option<State>>;

/// Looks every wanted node up.
///
/// # Errors
/// What the system says of the store.
pub fn plan(graph: &Graph, wanted: &[bool], store: &Store, force: &Force) -> anyhow::Result<Plan> {
    let mut plan: Plan = Vec::with_capacity(graph.nodes.len());
    for (id, node) in graph.nodes.iter().enumerate() {
        let state = if !wanted[id] {
            None
        } else if let Some(key) = Key::of(node, |source| output(&plan, source)) {
            let is_forced = force.has(graph, id);
            Some(look_up(key, is_forced, store)?)
        } else {
            let waits_for = node.inputs.iter().flat_map(|(_, sources)| sources).copied();
            Some(State::Waiting(waits_for.filter(|&source| output(&plan, source).is_none()).collect()))
        };
        plan.push(state);
    }
    Ok(plan)
}

/// Looks one key up.
pub(super) fn look_up(key: Key, is_forced: bool, store: &Store) -> anyhow::Result<State> {
    if is_forced {
        return Ok(State::Stale(key, Cause::Forced));
    }
    Ok(match store.find(key.digest)? {
        Found::Hit(entry) => State::Hit(key, entry),
        Found::Miss => State::Stale(key, Cause::Missing),
        Found::Unusable(why) => State::Stale(key, Cause::Unusable(why)),
    })
}

fn output(plan: &Plan, source: NodeId) -> Option<Digest> {
    match plan.get(source)? {
        Some(State::Hit(_, entry)) => Some(entry.output),
        _ => None,
    }
}

/// The nodes that targets name (see [`Graph::is_named`]), and all they need; every node if no name is given.
///
/// # Errors
/// The first name that is neither a stage nor a node.
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
