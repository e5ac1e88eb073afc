//! The tasks: dynamics, pictures, starts and goals.
//!
//! A task is one file here and one line in [`EnvName::open`].

mod planar;

use serde::{Deserialize, Serialize};

use crate::rng::Rng;

pub use planar::Planar;

/// The `[task]` table of a pipeline, every option explicit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Task {
    /// Which environment.
    pub env: EnvName,
    /// Standard deviation of the process noise, in units of the state.
    #[serde(default)]
    pub noise: f64,
}

impl Task {
    /// The environment with these options.
    pub fn open(&self) -> Box<dyn Environment> {
        self.env.open(self.noise)
    }

    /// What is out of range, as a clause.
    pub fn check(&self) -> Result<(), (&'static str, String)> {
        if self.noise.is_finite() && self.noise >= 0.0 {
            Ok(())
        } else {
            Err(("noise", format!("must be 0 or above, but is `{}`", self.noise)))
        }
    }
}

/// The environments there are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum EnvName {
    /// Navigation among obstacles.
    Planar,
}

impl EnvName {
    fn open(self, noise: f64) -> Box<dyn Environment> {
        match self {
            Self::Planar => Box::new(Planar { noise }),
        }
    }
}

/// A controlled system seen through binary pictures. States are true states: they never leave environments, evaluation
/// and the map probe.
pub trait Environment: Send + Sync {
    /// Height and width of an observation in pixels; a byte each, 0 or 255, row by row.
    fn picture_size(&self) -> (usize, usize);
    /// Largest absolute value of each component of an action; its length is the number of components.
    fn action_limit(&self) -> &'static [f64];
    /// Dimension of the latent space in the paper's appendix.
    fn latent_dim(&self) -> usize;
    /// Control steps of an episode, T in the paper.
    fn horizon(&self) -> usize;
    /// The next state. `action` is clipped to its limits.
    fn step(&self, state: &[f64], action: &[f64], rng: &mut Rng) -> Vec<f64>;
    /// Draws what is seen in a state, over what is in `picture`.
    fn render(&self, state: &[f64], picture: &mut [u8]);
    /// A uniformly random state.
    fn sample_state(&self, rng: &mut Rng) -> Vec<f64>;
    /// A uniformly random action.
    fn sample_action(&self, rng: &mut Rng) -> Vec<f64> {
        let limit = self.action_limit();
        limit.iter().map(|&limit| crate::nn::noise::uniform(rng, -1.0, 1.0) as f64 * limit).collect()
    }
    /// Where an episode starts.
    fn sample_start(&self, rng: &mut Rng) -> Vec<f64>;
    /// The goal states to choose from.
    fn goals(&self) -> Vec<Vec<f64>>;
    /// Whether a state counts as being at the goal.
    fn at_goal(&self, state: &[f64], goal: &[f64], radius: f64) -> bool;
    /// Radius of the goal in the paper's protocol.
    fn goal_radius(&self) -> f64;
    /// States that a latent map shows, and their (row, column) on the grid of the map.
    fn map_states(&self) -> Vec<(Vec<f64>, [usize; 2])>;
    /// A state's place in the unit square, for colours and trajectories.
    fn place(&self, state: &[f64]) -> [f32; 2];
    /// Obstacles to draw beside trajectories: row, column and radius in the unit square.
    fn obstacles(&self) -> Vec<[f32; 3]> {
        Vec::new()
    }
    /// Mean %-goal of the best possible controller on the default protocol, counting T+1 states.
    fn ceiling(&self) -> f64;
    /// Mean %-goal of online CARL in the paper's Table 1.
    fn paper_online(&self) -> f64;

    /// The picture of a state.
    fn picture(&self, state: &[f64]) -> Vec<u8> {
        let (height, width) = self.picture_size();
        let mut picture = vec![0; height * width];
        self.render(state, &mut picture);
        picture
    }
}
