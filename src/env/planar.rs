//! Planar navigation: a point among six obstacles, seen from above (paper, appendix "Planar System").
//!
//! Dynamics and images follow the public PCC implementation to the bit. Starts, goals and their radius follow the paper.

use serde_json::{Value, json};

use super::{
    BackwardSizes, DefaultsOf, Frames, NetworkSizes, Oracle, Preset, Start, System, TaskKind, TaskOption, World,
};
use crate::num::{rng::Rng, sampling};

const SIDE: usize = 40;
const LOW: f64 = 1.5;
const HIGH: f64 = 38.5;
const MAX_STEP: f64 = 3.0;
/// Centres (row, column) of the obstacles.
const OBSTACLES: [[f64; 2]; 6] = [[20.5, 5.5], [20.5, 13.5], [20.5, 27.5], [20.5, 35.5], [10.5, 20.5], [30.5, 20.5]];
/// Half the side of the box around an obstacle's centre that stops the agent. The drawn obstacle is larger.
const OBSTACLE_REACH: f64 = 1.5;

/// The task `planar`.
pub(super) const TASK: TaskKind = TaskKind {
    name: "planar",
    about: "navigation among obstacles",
    options: &[TaskOption::NOISE],
    world: World::System(|task| Box::new(Planar { noise: task.number("noise") })),
    // The obstacles are symmetric about 20.5, the walls about 20. So no mirror is a symmetry.
    symmetries: &[],
    networks: |_| NetworkSizes {
        latent: 2,
        is_convolutional: false,
        encoder: [300, 300],
        decoder: [300, 300],
        dynamics: [20, 20],
        backward: BackwardSizes { latent: 5, action: 5, observation: 100, joint: 100 },
    },
    defaults,
    ceiling: |task, _| (task.number("noise") == 0.0).then_some(78.87),
    paper_online: |_| Some(68.03),
};

fn defaults(of: &DefaultsOf<'_>) -> Value {
    match (of.stage, of.preset) {
        // The paper's share of samples from the preferred region.
        ("generate_data", _) if of.chosen("region") == Some("biased") => {
            json!({ "region": { "biased": { "preferred_share": 0.5 } } })
        }
        ("train_lce", _) if of.chosen("objective") == Some("value_guided") => json!({
            "lambda": { "prediction": 2.0, "consistency": 11.0 },
            "objective": { "value_guided": { "temperature": 1.0 / 30.0 } },
        }),
        // The paper's standard deviations for SOLAR, 1.5 pixels for data and for control.
        ("generate_trajectories", _) if of.chosen("actions") == Some("gaussian") => {
            json!({ "actions": { "gaussian": { "std": 1.5 / MAX_STEP } } })
        }
        // Nothing moves the point but its actions. A constant weight of 3 holds the codes to that from the first step.
        ("train_solar", Preset::Recipe) => {
            json!({ "first_dynamics": { "push": {} }, "beta": { "first": 3.0, "growth": 0.0 } })
        }
        ("control_solar", _) => json!({ "initial_std": 1.5 / MAX_STEP, "rollouts": 40 }),
        ("control_ilqr", Preset::Recipe) => json!({ "state_cost": 10.0, "action_cost": 1.0, "plan_length": 10 }),
        // PCC's r = 1 counts actions in units of the task. Ours are in units of the limit.
        ("control_ilqr", Preset::Paper) => {
            json!({ "state_cost": 10.0, "action_cost": MAX_STEP * MAX_STEP, "plan_length": 10 })
        }
        _ => json!({}),
    }
}

/// The planar system. A state is (row, column) in \[1.5, 38.5\]² pixels. An action is a displacement, each component
/// within ±3 pixels.
#[derive(Debug, Clone, Copy)]
pub struct Planar {
    /// Standard deviation of the process noise.
    pub noise: f64,
}

impl Planar {
    /// Whether a state is inside the walls and outside the obstacles.
    pub fn is_valid(state: &[f64]) -> bool {
        state.iter().all(|x| (LOW..=HIGH).contains(x))
            && !OBSTACLES.iter().any(|o| state.iter().zip(o).all(|(x, o)| (x - o).abs() <= OBSTACLE_REACH))
    }

    /// The noise-free next state. Only the end point is tested. A blocked move leaves the state unchanged.
    pub fn dynamics(state: &[f64], action: &[f64]) -> [f64; 2] {
        let moved = [0, 1].map(|i| (state[i] + action[i].clamp(-MAX_STEP, MAX_STEP)).clamp(LOW, HIGH));
        if Self::is_valid(&moved) { moved } else { [state[0], state[1]] }
    }
}

/// The position of a state in the unit square.
fn position(state: &[f64]) -> [f32; 2] {
    [0, 1].map(|i| (state[i] / SIDE as f64) as f32)
}

/// A uniformly random valid state with both coordinates below `high`.
fn sample_below(rng: &mut Rng, high: f64) -> Vec<f64> {
    loop {
        let state = [(); 2].map(|()| f64::from(sampling::uniform(rng, LOW as f32, high as f32)));
        if Planar::is_valid(&state) {
            return state.to_vec();
        }
    }
}

impl System for Planar {
    fn frames(&self) -> Frames {
        Frames::black_and_white(SIDE, SIDE, 1)
    }

    fn action_limit(&self) -> &[f64] {
        &[MAX_STEP, MAX_STEP]
    }

    fn horizon(&self) -> usize {
        40
    }

    fn step(&self, state: &[f64], action: &[f64], rng: &mut Rng) -> Vec<f64> {
        let mut next = Self::dynamics(state, action);
        if self.noise > 0.0 {
            let mut epsilon = [0.0; 2];
            sampling::fill_normal(rng, &mut epsilon);
            // As in the reference, the obstacles are not tested again.
            next = [0, 1].map(|i| (next[i] + self.noise * epsilon[i]).clamp(LOW, HIGH));
        }
        next.to_vec()
    }

    fn render(&self, state: &[f64], frame: &mut [u8]) {
        frame.fill(0);
        for [row, column] in OBSTACLES.map(|o| o.map(|x| x as usize)) {
            for (r, c) in (0..5).flat_map(|r| (0..5).map(move |c| (r, c))) {
                let corner = (r == 0 || r == 4) && (c == 0 || c == 4);
                if !corner {
                    frame[(row + r - 2) * SIDE + column + c - 2] = 255;
                }
            }
        }
        let [row, column] = [0, 1].map(|i| state[i].round_ties_even() as usize);
        for (r, c) in [(row - 1, column - 1), (row - 1, column), (row, column - 1), (row, column)] {
            frame[r * SIDE + c] = 255;
        }
    }

    fn sample_state(&self, rng: &mut Rng) -> Option<Vec<f64>> {
        Some(sample_below(rng, HIGH))
    }

    /// The preferred region is a square of 30 x 30 pixels without a goal.
    fn sample_biased(&self, is_preferred: bool, rng: &mut Rng) -> Option<Vec<f64>> {
        Some(sample_below(rng, if is_preferred { LOW + 30.0 } else { HIGH }))
    }

    fn sample_start(&self, start: Start, rng: &mut Rng) -> Vec<f64> {
        if start == Start::Fixed {
            return vec![5.0, 5.0];
        }
        [(); 2].map(|()| f64::from(sampling::uniform(rng, 3.0, 7.0))).to_vec()
    }

    fn goals(&self) -> Vec<Vec<f64>> {
        vec![vec![37.0, 37.0], vec![37.0, 3.0], vec![3.0, 37.0]]
    }

    fn at_goal(&self, state: &[f64], goal: &[f64], radius: f64) -> bool {
        let [dr, dc] = [0, 1].map(|i| state[i] - goal[i]);
        (dr * dr + dc * dc).sqrt() <= radius
    }

    fn goal_radius(&self) -> f64 {
        5.0
    }

    fn map_states(&self) -> Vec<(Vec<f64>, [usize; 2])> {
        let grid = (2..=38).flat_map(|r| (2..=38).map(move |c| [r, c]));
        grid.map(|[r, c]| (vec![r as f64, c as f64], [r - 2, c - 2])).filter(|(s, _)| Self::is_valid(s)).collect()
    }

    fn place(&self, state: &[f64]) -> Option<[f32; 2]> {
        Some(position(state))
    }

    fn place_radius(&self, radius: f64) -> f32 {
        (radius / SIDE as f64) as f32
    }

    fn obstacles(&self) -> Vec<[f32; 3]> {
        let radius = self.place_radius(OBSTACLE_REACH);
        OBSTACLES.iter().map(|o| position(o)).map(|[row, column]| [row, column, radius]).collect()
    }

    /// Moves straight towards the goal.
    fn oracle(&self) -> Option<Oracle> {
        Some(Box::new(|state, goal, _| [0, 1].map(|i| (goal[i] - state[i]).clamp(-MAX_STEP, MAX_STEP)).to_vec()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_are_1273_valid_grid_states() {
        assert_eq!(Planar { noise: 0.0 }.map_states().len(), 1273);
    }

    #[test]
    fn a_picture_has_at_most_130_lit_pixels() {
        let planar = Planar { noise: 0.0 };
        for (state, _) in planar.map_states() {
            let lit = planar.observe_at_rest(&state).iter().filter(|&&p| p == 255).count();
            assert!((126..=130).contains(&lit), "{state:?}: {lit}");
        }
    }
}
