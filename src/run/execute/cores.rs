//! Shares the cores among the nodes that run: one alone gets all of them.

use std::{collections::BTreeMap, sync::Mutex};

use crate::{num::Threads, pipeline::NodeId};

/// The cores and who uses them.
#[derive(Debug)]
pub(super) struct Cores {
    total: usize,
    users: Mutex<BTreeMap<NodeId, Threads>>,
}

impl Cores {
    pub(super) fn new(total: usize) -> Self {
        Self { total: total.max(1), users: Mutex::default() }
    }

    /// A share for a node that starts; the others get less.
    pub(super) fn join(&self, id: NodeId) -> Threads {
        let threads = Threads::new(1);
        self.change(|users| users.insert(id, threads.clone()));
        threads
    }

    /// Gives a node's share back to the others.
    pub(super) fn leave(&self, id: NodeId) {
        self.change(|users| users.remove(&id));
    }

    fn change(&self, change: impl FnOnce(&mut BTreeMap<NodeId, Threads>) -> Option<Threads>) {
        let mut users = self.users.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        change(&mut users);
        let share = self.total / users.len().max(1);
        users.values().for_each(|threads| threads.set(share));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lone_node_gets_every_core_and_shares_them_when_others_start() {
        let cores = Cores::new(4);
        let first = cores.join(0);
        assert_eq!(first.get(), 4);
        let second = cores.join(1);
        assert_eq!((first.get(), second.get()), (2, 2));
        cores.leave(0);
        assert_eq!(second.get(), 4);
        (2..9).for_each(|id| drop(cores.join(id)));
        assert_eq!(second.get(), 1);
    }
}
