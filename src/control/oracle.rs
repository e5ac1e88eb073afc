//! The policy that reads true states: how far the best representation could lead.

use anyhow::Context as _;

use super::policy::{Goal, Moment, Policy};
use crate::{
    env::{Oracle, Task},
    num::rng::Rng,
};

/// The task's own controller on true states.
pub struct OraclePolicy {
    goals: Vec<Vec<f64>>,
    limit: Vec<f64>,
    /// Gives the controller of a new episode.
    new_controller: Box<dyn Fn() -> Oracle>,
    /// The controller of this episode and its goal.
    episode: Option<(Oracle, usize)>,
}

impl OraclePolicy {
    /// The controller of a task.
    ///
    /// # Errors
    /// If the task has no controller on true states.
    pub fn of(task: &Task) -> anyhow::Result<Self> {
        let name = task.name();
        let system = task.system().with_context(|| format!("the simulator of `{name}` does not tell true states"))?;
        anyhow::ensure!(system.oracle().is_some(), "`{name}` has no controller on true states");
        let (goals, limit) = (system.goals(), system.action_limit().to_vec());
        let new_controller = Box::new(move || system.oracle().expect("it had a controller before"));
        Ok(Self { goals, limit, new_controller, episode: None })
    }
}

impl Policy for OraclePolicy {
    fn begin(&mut self, goal: Goal<'_>, _: Rng) {
        self.episode = Some(((self.new_controller)(), goal.index));
    }

    fn act(&mut self, moment: &Moment<'_>, rng: &mut Rng) -> Vec<f32> {
        let (controller, goal) = self.episode.as_mut().expect("an episode has begun");
        let state = moment.true_state.expect("the simulation of a system tells its state");
        let action = controller(state, &self.goals[*goal], rng);
        action.iter().zip(&self.limit).map(|(u, limit)| (u / limit) as f32).collect()
    }
}
