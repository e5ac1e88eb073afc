//! A lamp in a corridor, as a simulator that tells nobody its state: the least that a task can offer.

use carl_pipe::{
    env::{
        BackwardSizes, Frames, NetworkSizes, OptionValue, Simulator, Spec, Start, Symmetry, Task, TaskKind, TaskOption,
        World,
    },
    num::{rng::Rng, sampling},
};
use serde_json::json;

/// Pixels of the corridor.
const WIDTH: usize = 16;
const HEIGHT: usize = 4;

/// The task `corridor`: one file, and one line in `main`.
pub static TASK: TaskKind = TaskKind {
    name: "corridor",
    about: "a lamp that is to be pushed to one of two ends",
    options: &[TaskOption {
        name: "push",
        default: OptionValue::Number(2.0),
        range: 0.1..=8.0,
        unit: "pixels",
        about: "largest push of a control step",
    }],
    world: World::Simulator { spec, open: |task| Ok(Box::new(Corridor::new(task))) },
    // The corridor looks the same from both ends.
    symmetries: &[Symmetry {
        name: "mirror",
        about: "left and right change places",
        apply: |seen, _| {
            seen.mirror_columns();
            seen.reverse_action();
        },
    }],
    networks: |_| NetworkSizes {
        latent: 2,
        is_convolutional: false,
        encoder: [32, 32],
        decoder: [32, 32],
        dynamics: [10, 10],
        backward: BackwardSizes { latent: 5, action: 5, observation: 20, joint: 20 },
    },
    defaults: |of| match of.stage {
        // The simulator cannot be put into a state, so transitions follow episodes of random pushes.
        "generate_data" => json!({ "trajectory": 20 }),
        _ => json!({}),
    },
    ceiling: |_, _| None,
    paper_online: |_| None,
};

pub fn spec(task: &Task) -> Spec {
    Spec {
        frames: Frames::black_and_white(HEIGHT, WIDTH, 1),
        action_limit: vec![task.number("push")],
        horizon: 20,
        goals: 2,
        goal_radius: 1.5,
    }
}

struct Corridor {
    push: f64,
    /// The columns of the lamp and of its goal.
    lamp: f64,
    goal: f64,
}

impl Corridor {
    fn new(task: &Task) -> Self {
        Self { push: task.number("push"), lamp: 0.0, goal: 0.0 }
    }
}

fn column(goal: usize) -> f64 {
    [0.0, (WIDTH - 1) as f64][goal]
}

/// Two columns of lit pixels at the lamp.
fn picture(lamp: f64) -> Vec<u8> {
    let near = |x: usize| (x as f64 - lamp).abs() <= 1.0;
    (0..HEIGHT * WIDTH).map(|pixel| if near(pixel % WIDTH) { 255 } else { 0 }).collect()
}

impl Simulator for Corridor {
    fn reset(&mut self, _: Start, goal: usize, rng: &mut Rng) -> anyhow::Result<()> {
        self.lamp = f64::from(sampling::uniform(rng, 5.0, 10.0));
        self.goal = column(goal);
        Ok(())
    }

    fn step(&mut self, action: &[f32], _: &mut Rng) -> anyhow::Result<()> {
        let push = f64::from(action[0].clamp(-1.0, 1.0)) * self.push;
        self.lamp = (self.lamp + push).clamp(0.0, column(1));
        Ok(())
    }

    fn observe(&self) -> Vec<u8> {
        picture(self.lamp)
    }

    fn goal_image(&self, goal: usize) -> Vec<u8> {
        picture(column(goal))
    }

    fn is_at_goal(&self, radius: f64) -> bool {
        (self.lamp - self.goal).abs() <= radius
    }
}
