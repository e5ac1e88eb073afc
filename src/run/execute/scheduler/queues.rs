//! Which nodes may be looked up, are ready, or work. A step of a run costs as much as the nodes that it concerns, however
//! many nodes the graph has.

use std::{
    collections::{BTreeMap, BTreeSet},
    ops::Bound::{Excluded, Unbounded},
};

use super::{super::Order, node_run::Phase};
use crate::{digest::Digest, pipeline::NodeId};

/// The nodes of a run by what can be done with them.
#[derive(Debug)]
pub(super) struct Queues {
    /// For each node, the wanted nodes that take its output.
    takers: Vec<Vec<NodeId>>,
    /// Waiting nodes of which an input may have become known since they were last looked at.
    to_look_up: BTreeSet<NodeId>,
    ready: BTreeSet<NodeId>,
    /// The keys that nodes work on.
    working: BTreeMap<NodeId, Digest>,
    failed: BTreeSet<NodeId>,
}

impl Queues {
    /// Every wanted node waits.
    pub(super) fn new(order: &Order<'_>) -> Self {
        let mut takers = vec![Vec::new(); order.graph.nodes.len()];
        let wanted = || (0..order.graph.nodes.len()).filter(|&id| order.wanted[id]);
        for id in wanted() {
            for &source in order.graph.nodes[id].inputs.iter().flat_map(|(_, sources)| sources) {
                takers[source].push(id);
            }
        }
        Self {
            takers,
            to_look_up: wanted().collect(),
            ready: BTreeSet::new(),
            working: BTreeMap::new(),
            failed: BTreeSet::new(),
        }
    }

    /// Notes that a node enters a phase.
    pub(super) fn enter(&mut self, id: NodeId, phase: &Phase) {
        self.to_look_up.remove(&id);
        self.ready.remove(&id);
        self.working.remove(&id);
        self.failed.remove(&id);
        match phase {
            Phase::Waiting => _ = self.to_look_up.insert(id),
            Phase::Ready(_) => _ = self.ready.insert(id),
            Phase::Running { key, .. } => _ = self.working.insert(id, *key),
            Phase::Done(_) => self.to_look_up.extend(&self.takers[id]),
            Phase::Failed(_) => _ = self.failed.insert(id),
            Phase::Stopped => {}
        }
    }

    /// Takes out the nodes that may be looked up, in the order of the graph.
    pub(super) fn take_to_look_up(&mut self) -> BTreeSet<NodeId> {
        std::mem::take(&mut self.to_look_up)
    }

    /// The first ready node after another one, in the order of the graph.
    pub(super) fn ready_after(&self, last: Option<NodeId>) -> Option<NodeId> {
        self.ready.range((last.map_or(Unbounded, Excluded), Unbounded)).next().copied()
    }

    pub(super) fn has_ready(&self) -> bool {
        !self.ready.is_empty()
    }

    pub(super) fn has_failed(&self) -> bool {
        !self.failed.is_empty()
    }

    /// How many nodes work.
    pub(super) fn working(&self) -> usize {
        self.working.len()
    }

    pub(super) fn is_working(&self) -> bool {
        !self.working.is_empty()
    }

    /// Whether a node works on a key.
    pub(super) fn works_on(&self, key: Digest) -> bool {
        self.working.values().any(|&working| working == key)
    }
}
