//! Balance: a pole stands on a cart that is pushed left and right (paper, appendix "CartPole").
//!
//! Dynamics and images follow the public PCC implementation. That implementation has a control step of 0.02 s; our default
//! differs. The cart may leave the image.

use std::{f64::consts::PI, ops::Range};

use serde_json::{Value, json};

use super::{
    BackwardSizes, DefaultsOf, Frames, NetworkSizes, Oracle, Preset, SeenTransition, Start, Symmetry, System, Task,
    TaskKind, TaskOption, World,
    drawing::Canvas,
    ode,
    pole::{self, GRAVITY, disturbed, share, within, wrap},
};
use crate::num::{rng::Rng, sampling};

const SIDE: usize = 80;
/// Mass of the pole, mass of cart and pole, in kg; half the pole's length in m.
const POLE_MASS: f64 = 0.1;
const MASS: f64 = 1.1;
const LENGTH: f64 = 0.5;
/// Largest force in N.
const MAX_FORCE: f64 = 10.0;
/// Bounds of the velocities in rad/s and m/s, and the position in m at which the cart leaves the image.
const MAX_OMEGA: f64 = 2.0 * PI;
const MAX_SPEED: f64 = 6.0;
const TRACK: f64 = 2.4;
/// Largest angle of random states in rad. It is twice the goal's, so that random states cover every start.
const MAX_ANGLE: f64 = PI / 5.0;

/// The task `cart_pole`.
pub(super) const TASK: TaskKind = TaskKind {
    name: "cart_pole",
    about: "balance of a pole on a cart",
    // At the public implementation's 0.02 s no picture shows what a force did.
    options: &[TaskOption::NOISE, TaskOption::STEP],
    world: World::System(|task| Box::new(CartPole { noise: task.number("noise"), step: task.number("step") })),
    symmetries: &[pole::MIRROR, SHIFT],
    networks: |_| NetworkSizes {
        latent: 8,
        is_convolutional: true,
        encoder: [1000, 200],
        decoder: [200, 1000],
        dynamics: [40, 40],
        backward: BackwardSizes { latent: 10, action: 10, observation: 300, joint: 300 },
    },
    defaults,
    ceiling,
    paper_online: |_| Some(95.34),
};

/// The dynamics and the goal do not depend on where the cart is.
const SHIFT: Symmetry = Symmetry { name: "shift", about: "the cart stands elsewhere on its track", apply: shift };
/// Rows of pixels in which the cart is wider than its pole.
const CART_ROWS: Range<usize> = 72..75;
/// Columns of the cart's centre at which the whole cart is in the picture.
const CENTRES: [isize; 2] = [8, 72];

/// Shifts the pictures at random such that the whole cart stays in them. What lies beyond an edge of the picture is not
/// known, so a shift never moves pixels away from an edge that they touch.
fn shift(seen: &mut SeenTransition<'_>, rng: &mut Rng) {
    let (Some(cart), Some(all)) = (seen.lit_columns(CART_ROWS), seen.lit_columns(0..SIDE)) else { return };
    let [left, right] = CENTRES.map(|column| column - (cart.0 + cart.1) as isize / 2);
    let left = if all.1 + 1 == SIDE { left.max(0) } else { left };
    let right = if all.0 == 0 { right.min(0) } else { right };
    if left <= right {
        seen.shift_columns(left + sampling::index(rng, (right - left) as usize + 1) as isize);
    }
}

fn ceiling(task: &Task, start: Start) -> Option<f64> {
    let known = [(0.02, 98.46), (0.05, 99.43)];
    let usual = known.iter().find(|it| it.0 == task.number("step") && task.number("noise") == 0.0).map(|it| it.1);
    usual.map(|usual| if start == Start::Narrow { 100.0 } else { usual })
}

fn defaults(of: &DefaultsOf<'_>) -> Value {
    match (of.stage, of.preset) {
        // The paper's standard deviations for SOLAR are forces, 10 for data and 5 for control.
        ("generate_trajectories", _) if of.chosen("actions") == Some("gaussian") => {
            json!({ "actions": { "gaussian": { "std": 10.0 / MAX_FORCE } } })
        }
        ("control_solar", _) => json!({ "initial_std": 5.0 / MAX_FORCE, "rollouts": 20 }),
        // The paper's share of samples from the preferred region.
        ("generate_data", _) if of.chosen("region") == Some("biased") => {
            json!({ "region": { "biased": { "preferred_share": 0.8 } } })
        }
        ("train_lce", preset) => train_lce(of, preset),
        // A pole that has fallen, or left the picture, shows nothing more.
        ("collect", Preset::Recipe) => json!({ "episode": 60 }),
        // A controller catches a falling pole within a second, and 15 steps are 0.75 s. From most states of the data
        // the pole falls under every policy, so critics that also learn to reach such states learn little.
        ("train_sac", Preset::Recipe) => json!({
            "rollout": 15,
            "learning_rate_end_factor": 0.05,
            "relabel": 0.0,
            "symmetries": symmetries(),
            "symmetric_copies": 8,
        }),
        // A leaning pole asks for the whole force at once. Plans without limits count on a greater force.
        ("control_ilqr", Preset::Recipe) => {
            json!({ "state_cost": 100.0, "action_cost": 1.0, "plan_length": 10, "control_limited": true })
        }
        // PCC's r = 1 counts actions in units of the task. Ours are in units of the limit.
        ("control_ilqr", Preset::Paper) => {
            json!({ "state_cost": 100.0, "action_cost": MAX_FORCE * MAX_FORCE, "plan_length": 5 })
        }
        _ => json!({}),
    }
}

fn train_lce(of: &DefaultsOf<'_>, preset: Preset) -> Value {
    let mut table = match of.chosen("objective") {
        Some("value_guided") => json!({
            "lambda": { "prediction": 1.0, "consistency": 7.0 },
            "objective": { "value_guided": { "temperature": 1.0 / 40.0 } },
        }),
        _ => json!({}),
    };
    if preset == Preset::Recipe {
        // A pole moves without an action, and nothing blocks it, so the anchor meets no outliers.
        table["passive_dynamics"] = "quadratic".into();
        table["lambda"]["anchor"] = 10.0.into();
        // A pole is few pixels wide. Patches of 8 x 8 lose its motion. Patches of 4 x 4 need dropout.
        let patches = json!({ "side": 4, "dropout": 0.2 });
        // One step shows little of an action. A map that shows more of it learns the data by heart.
        let (networks, scale, least_alignment) =
            if of.chosen("networks").is_none_or(|networks| networks == "shared_frames") {
                (json!({ "shared_frames": patches }), 0.25, 0.7)
            } else {
                (json!({ "pooled_patches": patches }), 0.5, 0.0)
            };
        table["networks"] = networks;
        table["least_alignment"] = least_alignment.into();
        table["warm_up"]["loss"] = json!({ "scale": scale, "anchor": 30.0, "huber_delta": 1000.0 });
        // Codes of so few pictures jitter as much as they move, so F learns the motion last.
        table["slopes"] = json!({ "exact": { "refit_steps": 2000 } });
        // A thousand random transitions share no pictures. Networks that read every pixel learn the pictures by heart,
        // and so does a warm-up that decodes none.
        table["warm_up"]["anchor_epochs"] = 0.into();
        table["symmetries"] = symmetries();
        table["symmetric_copies"] = 8.into();
    }
    table
}

/// Shares of the samples that the task's symmetries change.
fn symmetries() -> Value {
    json!({ "mirror": 0.5, "shift": 0.3 })
}

/// The cart-pole. A state is (angle, angular velocity, position, velocity) in rad, rad/s, m and m/s; angle 0 is upright. An
/// action is a force on the cart. A positive force lowers the angle.
#[derive(Debug, Clone, Copy)]
pub struct CartPole {
    /// Standard deviation of the process noise.
    pub noise: f64,
    /// Control step in seconds.
    pub step: f64,
}

impl CartPole {
    /// The noise-free next state.
    pub fn dynamics(&self, state: &[f64], action: &[f64]) -> [f64; 4] {
        let force = action[0].clamp(-MAX_FORCE, MAX_FORCE);
        let start = [state[0], state[1], state[2], state[3]];
        let [theta, omega, x, v] = ode::after(|state| slope(state, force), start, &[force], self.step);
        [wrap(theta, PI), omega.clamp(-MAX_OMEGA, MAX_OMEGA), x, v.clamp(-MAX_SPEED, MAX_SPEED)]
    }
}

fn slope(&[theta, omega, _, v]: &[f64; 4], force: f64) -> [f64; 4] {
    let (sin, cos) = (libm::sin(theta), libm::cos(theta));
    let push = force + POLE_MASS * LENGTH * omega * omega * sin;
    let turning = (MASS * GRAVITY * sin - cos * push) / (4.0 / 3.0 * MASS * LENGTH - POLE_MASS * LENGTH * cos * cos);
    [omega, turning, v, (push - POLE_MASS * LENGTH * turning * cos) / MASS]
}

impl System for CartPole {
    fn frames(&self) -> Frames {
        Frames::black_and_white(SIDE, SIDE, 2)
    }

    fn action_limit(&self) -> &[f64] {
        &[MAX_FORCE]
    }

    fn horizon(&self) -> usize {
        200
    }

    fn step(&self, state: &[f64], action: &[f64], rng: &mut Rng) -> Vec<f64> {
        disturbed(self.dynamics(state, action), self.noise, rng)
    }

    fn render(&self, state: &[f64], frame: &mut [u8]) {
        let (theta, x) = (state[0], 40.0 + state[2] / TRACK * 32.0);
        let mut canvas = Canvas::new(frame, SIDE);
        canvas.rectangle([x - 8.0, 66.0], [x + 8.0, 74.0]);
        canvas.line([x, 70.0], [x + 52.0 * libm::sin(theta), 70.0 - 52.0 * libm::cos(theta)], 6);
    }

    fn sample_state(&self, rng: &mut Rng) -> Option<Vec<f64>> {
        Some([MAX_ANGLE, MAX_OMEGA, TRACK, MAX_SPEED].map(|reach| within(rng, reach)).to_vec())
    }

    fn sample_biased(&self, is_preferred: bool, rng: &mut Rng) -> Option<Vec<f64>> {
        let mut state = self.sample_state(rng)?;
        if is_preferred {
            state[0] = pole::on_either_side(rng, PI / 10.0, PI / 6.0);
        }
        Some(state)
    }

    fn sample_start(&self, start: Start, rng: &mut Rng) -> Vec<f64> {
        if start == Start::Fixed {
            return vec![PI / 12.0, 0.0, 0.0, 0.0];
        }
        let reach = if start == Start::Narrow { PI / 10.0 } else { PI / 6.0 };
        vec![within(rng, reach), 0.0, 0.0, 0.0]
    }

    fn goals(&self) -> Vec<Vec<f64>> {
        vec![vec![0.0; 4]]
    }

    /// The position of the cart does not matter.
    fn at_goal(&self, state: &[f64], _: &[f64], radius: f64) -> bool {
        state[0].abs() <= radius
    }

    fn goal_radius(&self) -> f64 {
        PI / 10.0
    }

    /// A grid over angles and positions at rest.
    fn map_states(&self) -> Vec<(Vec<f64>, [usize; 2])> {
        let at_rest = |([theta, x], cell): ([f64; 2], _)| (vec![theta, 0.0, x, 0.0], cell);
        pole::grid([MAX_ANGLE, TRACK], [31, 33]).map(at_rest).collect()
    }

    /// The state before has the same velocities. Two frames show the mean velocities between them.
    fn before(&self, state: &[f64]) -> Vec<f64> {
        vec![state[0] - state[1] * self.step, state[1], state[2] - state[3] * self.step, state[3]]
    }

    fn place(&self, state: &[f64]) -> Option<[f32; 2]> {
        Some([share(state[0], MAX_ANGLE), share(state[2], TRACK)])
    }

    fn place_radius(&self, radius: f64) -> f32 {
        (radius / (2.0 * MAX_ANGLE)) as f32
    }

    /// Linear feedback: large gains on the angle, and gains on the position that suffice to return to the middle.
    fn oracle(&self) -> Option<Oracle> {
        const GAIN: [f64; 4] = [50.0, 11.0, 2.5, 4.5];
        Some(Box::new(|state, _, _| {
            let force = GAIN.iter().zip(state).map(|(gain, s)| gain * s).sum::<f64>();
            vec![force.clamp(-MAX_FORCE, MAX_FORCE)]
        }))
    }
}
