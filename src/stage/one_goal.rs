//! One goal, for stages that can leave the others out.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// One of the task's goals.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(super) struct OneGoal {
    /// Its number.
    goal: u64,
}

impl OneGoal {
    /// Its number among the `goals` of the task.
    ///
    /// # Errors
    /// The task has no such goal.
    pub(super) fn number(self, goals: usize) -> anyhow::Result<usize> {
        let goal = self.goal;
        anyhow::ensure!(goal < goals as u64, "there is no goal {goal}: the task has {goals}");
        Ok(goal as usize)
    }
}
