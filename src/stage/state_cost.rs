//! A cost that the true state decides: what SOLAR observes in its upper baseline, and nothing else.

use anyhow::Context as _;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Refusal, above_zero};
use crate::env::{System, Task};

/// The cost of a step, κ |x - x_g|² + ½ r |a|² in the coordinates of the task.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Distance {
    /// κ, the cost of a squared unit of distance from the goal.
    pub(super) state_cost: f64,
    /// r, the cost of an action; an action's limit is 1.
    pub(super) action_cost: f64,
}

impl Default for Distance {
    fn default() -> Self {
        Self { state_cost: 50.0, action_cost: 1.0 }
    }
}

impl Distance {
    /// Refuses costs that are not above 0.
    pub(super) fn check(self, state: &'static str, action: &'static str, refusals: &mut Vec<Refusal>) {
        above_zero(refusals, state, self.state_cost);
        above_zero(refusals, action, self.action_cost);
    }
}

/// Tells costs of true states.
pub(super) struct Observer {
    system: Box<dyn System>,
    goals: Vec<Vec<f64>>,
    distance: Distance,
}

impl Observer {
    /// The costs of a task.
    pub(super) fn new(task: &Task, distance: Distance) -> anyhow::Result<Self> {
        let name = task.name();
        let system = task.system().with_context(|| format!("the simulator of `{name}` does not tell true states"))?;
        let goals = system.goals();
        anyhow::ensure!(!system.coordinates(&goals[0]).is_empty(), "`{name}` has no coordinates to measure costs in");
        Ok(Self { system, goals, distance })
    }

    /// The cost of an action in a state.
    pub(super) fn cost(&self, state: &[f64], goal: usize, action: &[f32]) -> f32 {
        let squares = |numbers: &mut dyn Iterator<Item = f32>| numbers.map(|x| f64::from(x * x)).sum::<f64>();
        let (at, goal) = (self.system.coordinates(state), self.system.coordinates(&self.goals[goal]));
        let away = squares(&mut at.iter().zip(&goal).map(|(at, goal)| at - goal));
        let effort = squares(&mut action.iter().copied());
        (self.distance.state_cost * away + 0.5 * self.distance.action_cost * effort) as f32
    }
}
