//! A system whose states and equations are known, and its simulator.
//!
//! Every built-in task is one. Beyond simulation it allows data from any state, probes of latent maps, and controllers
//! that read true states.

use super::{Frames, Simulator, Snapshot, Spec, Start};
use crate::num::rng::Rng;

/// A controller that knows the true state and the goal state: `(state, goal, stream)` to an action within its limits, in
/// units of the task. One value controls one episode.
pub type Oracle = Box<dyn FnMut(&[f64], &[f64], &mut Rng) -> Vec<f64>>;

/// A controlled system with known states. States are true states: only simulation, evaluation and map probes read them.
pub trait System: Send + Sync {
    /// The frames of an observation.
    fn frames(&self) -> Frames;
    /// Largest absolute value of each component of an action; its length is the number of components.
    fn action_limit(&self) -> &[f64];
    /// Control steps of an episode, T in the paper.
    fn horizon(&self) -> usize;
    /// The next state. `action` is in units of the task and is clipped to its limits.
    fn step(&self, state: &[f64], action: &[f64], rng: &mut Rng) -> Vec<f64>;
    /// Draws a state over what is in `frame`.
    fn render(&self, state: &[f64], frame: &mut [u8]);
    /// Where an episode starts.
    fn sample_start(&self, start: Start, rng: &mut Rng) -> Vec<f64>;
    /// The goal states to choose from.
    fn goals(&self) -> Vec<Vec<f64>>;
    /// Whether a state is within `radius` of a goal.
    fn at_goal(&self, state: &[f64], goal: &[f64], radius: f64) -> bool;
    /// Radius of a goal in the paper's protocol, in units of the state.
    fn goal_radius(&self) -> f64;

    /// A uniformly random state; `None` where states are not sampled.
    fn sample_state(&self, _: &mut Rng) -> Option<Vec<f64>> {
        None
    }
    /// A random state of the region that the paper's experiment with biased sampling prefers, or of the other region of
    /// that experiment; `None` where the experiment does not exist.
    fn sample_biased(&self, _is_preferred: bool, _: &mut Rng) -> Option<Vec<f64>> {
        None
    }
    /// States that a latent map shows, each with its (row, column) on the grid of the map; none where there is no map.
    fn map_states(&self) -> Vec<(Vec<f64>, [usize; 2])> {
        Vec::new()
    }
    /// The state about one control step before a state, for the older frame of a map's observation.
    fn before(&self, state: &[f64]) -> Vec<f64> {
        state.to_vec()
    }
    /// The position of a state in the unit square, for colours and trajectories; `None` where there is no such picture.
    fn place(&self, _state: &[f64]) -> Option<[f32; 2]> {
        None
    }
    /// Coordinates in which a perfect map is affine: the position, or points of a circle for an angle that wraps around.
    fn coordinates(&self, state: &[f64]) -> Vec<f32> {
        self.place(state).map(Vec::from).unwrap_or_default()
    }
    /// The radius of a goal as a length in the unit square.
    fn place_radius(&self, _radius: f64) -> f32 {
        0.0
    }
    /// Obstacles to draw beside trajectories: row, column and radius in the unit square.
    fn obstacles(&self) -> Vec<[f32; 3]> {
        Vec::new()
    }
    /// A controller on true states that comes close to the ceiling; `None` where there is none.
    fn oracle(&self) -> Option<Oracle> {
        None
    }

    /// What is known of the task before it is simulated.
    fn spec(&self) -> Spec {
        Spec {
            frames: self.frames(),
            action_limit: self.action_limit().to_vec(),
            horizon: self.horizon(),
            goals: self.goals().len(),
            goal_radius: self.goal_radius(),
        }
    }

    /// The observation in a state that was reached from the state `before`.
    fn observe(&self, before: &[f64], state: &[f64]) -> Vec<u8> {
        let frames = self.frames();
        let mut observation = vec![0; frames.count * frames.pixels()];
        let (older, newer) = observation.split_at_mut((frames.count - 1) * frames.pixels());
        if !older.is_empty() {
            self.render(before, older);
        }
        self.render(state, newer);
        observation
    }

    /// The observation in a state at rest: both frames show the same state.
    fn observe_at_rest(&self, state: &[f64]) -> Vec<u8> {
        self.observe(state, state)
    }

    /// A uniformly random action, in units of the task.
    fn sample_action(&self, rng: &mut Rng) -> Vec<f64> {
        let limit = self.action_limit();
        limit.iter().map(|&limit| crate::num::sampling::uniform(rng, -1.0, 1.0) as f64 * limit).collect()
    }
}

/// The simulator of a system with known states.
struct Simulation {
    system: Box<dyn System>,
    goals: Vec<Vec<f64>>,
    goal: usize,
    now: Snapshot,
}

/// Simulates a system with known states. It stands at its first goal until the first reset.
pub fn simulate(system: Box<dyn System>) -> Box<dyn Simulator> {
    let goals = system.goals();
    let now = Snapshot::at_rest(goals[0].clone());
    Box::new(Simulation { system, goals, goal: 0, now })
}

impl Simulation {
    fn set_goal(&mut self, goal: usize) -> anyhow::Result<()> {
        let count = self.goals.len();
        anyhow::ensure!(goal < count, "there is no goal {goal}: the task has {count}");
        self.goal = goal;
        Ok(())
    }
}

impl Simulator for Simulation {
    fn reset(&mut self, start: Start, goal: usize, rng: &mut Rng) -> anyhow::Result<()> {
        self.set_goal(goal)?;
        self.now = Snapshot::at_rest(self.system.sample_start(start, rng));
        Ok(())
    }

    fn step(&mut self, action: &[f32], rng: &mut Rng) -> anyhow::Result<()> {
        let limit = self.system.action_limit();
        let action: Vec<f64> = action.iter().zip(limit).map(|(&share, limit)| f64::from(share) * limit).collect();
        let next = self.system.step(&self.now.state, &action, rng);
        anyhow::ensure!(
            next.iter().all(|number| number.is_finite()),
            "the state is not finite: lower `noise` in `[task]`"
        );
        self.now.before = std::mem::replace(&mut self.now.state, next);
        Ok(())
    }

    fn observe(&self) -> Vec<u8> {
        self.system.observe(&self.now.before, &self.now.state)
    }

    fn goal_image(&self, goal: usize) -> Vec<u8> {
        self.system.observe_at_rest(&self.goals[goal])
    }

    fn is_at_goal(&self, radius: f64) -> bool {
        self.system.at_goal(&self.now.state, &self.goals[self.goal], radius)
    }

    fn snapshot(&self) -> Option<&Snapshot> {
        Some(&self.now)
    }

    fn restore(&mut self, snapshot: &Snapshot, goal: usize) -> anyhow::Result<()> {
        self.set_goal(goal)?;
        let Snapshot { before, state } = snapshot;
        let width = self.goals[goal].len();
        let fits = |state: &[f64]| state.len() == width && state.iter().all(|number| number.is_finite());
        anyhow::ensure!(fits(before) && fits(state), "a state of the task is {width} finite numbers");
        self.now = snapshot.clone();
        Ok(())
    }
}
