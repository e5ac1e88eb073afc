//! The tasks: dynamics, pictures, starts, goals and defaults. A task is one file here and one line in `registry`.

mod cart_pole;
mod ceiling;
mod defaults;
mod drawing;
mod ode;
mod planar;
mod planner;
mod pole;
mod registry;
mod swing_up;
mod task;
mod three_pole;

use crate::num::rng::Rng;

pub use cart_pole::CartPole;
pub use ceiling::Protocol;
pub use defaults::{BackwardSizes, DefaultsOf, NetworkSizes, Preset};
pub use planar::Planar;
pub use registry::{OptionValue, TaskKind, TaskOption, add_to_registry, registry, task_kind};
pub use swing_up::SwingUp;
pub use task::{RefusedOption, Task};
pub use three_pole::ThreePole;

/// A controller that knows the true state and the goal state, and gives an action within its limits. It draws from the
/// stream where it searches.
pub type Oracle<'a> = Box<dyn FnMut(&[f64], &[f64], &mut Rng) -> Vec<f64> + 'a>;

/// Where episodes of an evaluation start, by protocol.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Start {
    /// As the task says.
    #[default]
    Usual,
    /// By the letter of the paper: pendulum and arm hang, the arm at π, 2π/3 and π/3. Elsewhere as usual.
    Paper,
    /// The cart-pole within ±π/10, where the pole is at its goal already. Elsewhere as usual.
    Narrow,
}

/// A controlled system seen through binary pictures. States are true states: they never leave environments, evaluation
/// and the map probe.
pub trait Environment: Send + Sync {
    /// Height and width of a frame in pixels; a byte each, 0 or 255, row by row.
    fn frame_size(&self) -> (usize, usize);
    /// Frames of an observation: 2 where a single one does not show velocities.
    fn frames(&self) -> usize {
        1
    }
    /// Largest absolute value of each component of an action; its length is the number of components.
    fn action_limit(&self) -> &[f64];
    /// Control steps of an episode, T in the paper.
    fn horizon(&self) -> usize;
    /// The next state. `action` is clipped to its limits.
    fn step(&self, state: &[f64], action: &[f64], rng: &mut Rng) -> Vec<f64>;
    /// Draws what is seen in a state, over what is in `frame`.
    fn render(&self, state: &[f64], frame: &mut [u8]);
    /// A uniformly random state.
    fn sample_state(&self, rng: &mut Rng) -> Vec<f64>;
    /// A random state of the region that the paper's experiment with biased sampling prefers, or of what else it uses.
    fn sample_biased(&self, is_preferred: bool, rng: &mut Rng) -> Vec<f64>;
    /// Share of the preferred region in that experiment, p in the paper.
    fn biased_share(&self) -> f64;
    /// A uniformly random action.
    fn sample_action(&self, rng: &mut Rng) -> Vec<f64> {
        let limit = self.action_limit();
        limit.iter().map(|&limit| crate::num::sampling::uniform(rng, -1.0, 1.0) as f64 * limit).collect()
    }
    /// Where an episode starts.
    fn sample_start(&self, rng: &mut Rng) -> Vec<f64>;
    /// Where an episode starts under a protocol.
    fn sample_start_as(&self, _: Start, rng: &mut Rng) -> Vec<f64> {
        self.sample_start(rng)
    }
    /// The goal states to choose from.
    fn goals(&self) -> Vec<Vec<f64>>;
    /// Whether a state counts as being at the goal.
    fn at_goal(&self, state: &[f64], goal: &[f64], radius: f64) -> bool;
    /// Radius of the goal in the paper's protocol, in units of the state.
    fn goal_radius(&self) -> f64;
    /// States that a latent map shows, and their (row, column) on the grid of the map.
    fn map_states(&self) -> Vec<(Vec<f64>, [usize; 2])>;
    /// The state about one control step before a state, for the older frame of a map's observation.
    fn before(&self, state: &[f64]) -> Vec<f64> {
        state.to_vec()
    }
    /// A state's place in the unit square, for colours and trajectories.
    fn place(&self, state: &[f64]) -> [f32; 2];
    /// What a perfect map is affine in: a state's place, or points of a circle where an angle turns around.
    fn coordinates(&self, state: &[f64]) -> Vec<f32> {
        self.place(state).to_vec()
    }
    /// A radius of the goal as a length in the unit square.
    fn place_radius(&self, radius: f64) -> f32;
    /// Obstacles to draw beside trajectories: row, column and radius in the unit square.
    fn obstacles(&self) -> Vec<[f32; 3]> {
        Vec::new()
    }
    /// A controller on true states that comes close to the ceiling.
    fn oracle(&self) -> Oracle<'_>;
    /// Mean %-goal of the best possible controller on the default protocol, counting T+1 states; `None` with options of
    /// the dynamics for which nobody has measured it.
    fn ceiling(&self) -> Option<f64>;
    /// The same under another protocol of starts.
    fn ceiling_as(&self, _: Start) -> Option<f64> {
        self.ceiling()
    }
    /// Mean %-goal of online CARL in the paper's Table 1, if it has this system.
    fn paper_online(&self) -> Option<f64>;

    /// Height and width of an observation: its frames stand on each other, the older one on top.
    fn picture_size(&self) -> (usize, usize) {
        let (height, width) = self.frame_size();
        (self.frames() * height, width)
    }

    /// What is observed in a state that was reached from the state `before`.
    fn observe(&self, before: &[f64], state: &[f64]) -> Vec<u8> {
        let (height, width) = self.picture_size();
        let mut picture = vec![0; height * width];
        let (older, newer) = picture.split_at_mut((height - self.frame_size().0) * width);
        if !older.is_empty() {
            self.render(before, older);
        }
        self.render(state, newer);
        picture
    }

    /// What is observed of a state at rest: the start of an episode, and its goal.
    fn picture(&self, state: &[f64]) -> Vec<u8> {
        self.observe(state, state)
    }
}
