//! Groups runs of one pipeline by their results, so that a run that only used results counts as one with the run that
//! made them.

use crate::run::holdings::{Holding, Standing};

/// Runs, one of which has the results of all.
#[derive(Debug)]
pub(super) struct Group {
    /// The run with the results of all; of several, the one that made them, so the oldest.
    leader: usize,
    /// The newest run.
    newest: usize,
    /// The newest run that finished.
    newest_finished: Option<usize>,
}

impl Group {
    /// Whether a run of the group finished.
    pub(super) fn is_finished(&self) -> bool {
        self.newest_finished.is_some()
    }

    /// The runs that stay where the group stays.
    pub(super) fn members(&self) -> impl Iterator<Item = usize> + use<> {
        [Some(self.leader), Some(self.newest), self.newest_finished].into_iter().flatten()
    }
}

/// The groups of these runs, which are positions in `runs` and newest first. A group is as new as its newest run.
pub(super) fn groups(runs: &[Holding], own: &[usize]) -> Vec<Group> {
    let mut groups: Vec<Group> = Vec::new();
    for &at in own {
        let results = &runs[at].results;
        let finished = Some(at).filter(|_| runs[at].state == Standing::Finished);
        let leads = |group: &Group| runs[group.leader].results.is_superset(results);
        let follows = |group: &Group| runs[group.leader].results.is_subset(results);
        let Some(first) = groups.iter().position(|group| leads(group) || follows(group)) else {
            groups.push(Group { leader: at, newest: at, newest_finished: finished });
            continue;
        };
        groups[first].newest_finished = groups[first].newest_finished.or(finished);
        if follows(&groups[first]) {
            groups[first].leader = at;
            // Its results may be more than those of further groups.
            for other in (first + 1..groups.len()).rev() {
                if runs[groups[other].leader].results.is_subset(results) {
                    let other = groups.remove(other);
                    let finished = [groups[first].newest_finished, other.newest_finished];
                    groups[first].newest_finished = finished.into_iter().flatten().min();
                }
            }
        }
    }
    groups
}
