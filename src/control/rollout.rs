//! Closed-loop control from pictures: policy and planner see E(x) and E(x_g), never a state. Beside it the controller that does
//! see states, for what the best representation could reach.

use super::{
    agent::Agent,
    ilqr::{Ilqr, LatentDynamics, Planner},
};
use crate::{
    env::{Environment, Start},
    lce::{LceModel, PreparedEncoder},
    num::{rng::Rng, sampling},
};

/// What to do when an action changed nothing in the picture: the mean action would repeat for ever.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Unstick {
    /// Nothing: the policy alone.
    Off,
    /// One uniformly random action.
    Random,
}

/// Who acts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Controller {
    /// What was learned, from pictures.
    #[default]
    Agent,
    /// iLQR, which plans in the model, from pictures.
    Ilqr,
    /// The task's own controller, which knows the true state: what the best representation could reach.
    Oracle,
}

/// How a policy's actions are chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Acting {
    /// The mean action.
    Mean,
    /// A sample of the policy.
    Sample,
    /// Samples of the policy for so many steps, then uniformly random actions.
    SampleThenRandom(usize),
}

/// One step of an episode, as the world saw it.
#[derive(Debug, Clone, PartialEq)]
pub struct Step {
    /// The true state before.
    pub state: Vec<f64>,
    /// The picture before.
    pub before: Vec<u8>,
    /// The action, in -1..1.
    pub action: Vec<f32>,
    /// The true state after.
    pub next: Vec<f64>,
    /// The picture after.
    pub after: Vec<u8>,
}

/// Where an episode starts and should end.
#[derive(Debug, Clone, PartialEq)]
pub struct Episode {
    /// The true state before the start, which two frames show; the start itself where the system is at rest.
    pub before: Vec<f64>,
    /// The true start state.
    pub start: Vec<f64>,
    /// The true goal state.
    pub goal: Vec<f64>,
}

impl Episode {
    /// Starts at rest.
    pub fn at_rest(start: Vec<f64>, goal: Vec<f64>) -> Self {
        Self { before: start.clone(), start, goal }
    }
}

/// Where an episode was left, for whoever goes on with it. It holds true states: nothing that learns may read it.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Standing {
    /// The true state one step ago.
    pub before: Vec<f64>,
    /// The true state.
    pub state: Vec<f64>,
    /// Which of the task's goals.
    pub goal: usize,
    /// Steps done.
    pub steps: usize,
}

/// Draws episodes: fresh starts, and goals shared out evenly in random order.
pub fn draw_episodes(env: &dyn Environment, start: Start, count: usize, rng: &mut Rng) -> Vec<Episode> {
    let goals = env.goals();
    let mut order: Vec<u32> = (0..count as u32).collect();
    sampling::shuffle(rng, &mut order);
    order
        .into_iter()
        .map(|i| Episode::at_rest(env.sample_start_as(start, rng), goals[i as usize % goals.len()].clone()))
        .collect()
}

/// Runs one episode for `steps` steps with a policy.
pub fn run(
    env: &dyn Environment,
    (model, agent): (&LceModel, &Agent),
    episode: &Episode,
    steps: usize,
    (acting, unstick): (Acting, Unstick),
    rng: &mut Rng,
) -> Vec<Step> {
    let mut encoder = PreparedEncoder::new(model, 1);
    let z_goal = encoder.mean(&env.picture(&episode.goal));
    let mut step = 0;
    walk(env, episode, steps, rng, |seen, rng| {
        let z = encoder.mean(seen.picture);
        let mut epsilon = vec![0.0; agent.action];
        sampling::fill_normal(rng, &mut epsilon);
        let mut action = agent.act(&z, &z_goal, (acting != Acting::Mean).then_some(&epsilon));
        if matches!(acting, Acting::SampleThenRandom(follows) if step >= follows) {
            draw_uniformly(&mut action, rng);
        }
        step += 1;
        unstick.apply(seen.is_stuck, &mut action, rng);
        action
    })
}

/// Runs one episode for `steps` steps with iLQR, which draws the beginnings of its plans from a stream of its own.
pub fn run_ilqr(
    env: &dyn Environment,
    (model, ilqr): (&LceModel, &Ilqr),
    episode: &Episode,
    steps: usize,
    unstick: Unstick,
    (rng, plans): (&mut Rng, Rng),
) -> Vec<Step> {
    let mut encoder = PreparedEncoder::new(model, 1);
    let mut code = |picture: &[u8]| encoder.mean(picture).into_iter().map(f64::from).collect::<Vec<_>>();
    let mut planner = Planner::new(ilqr, LatentDynamics::of(model), code(&env.picture(&episode.goal)), plans);
    let mut left = steps;
    walk(env, episode, steps, rng, |seen, rng| {
        let planned = planner.act(&code(seen.picture), left);
        left -= 1;
        let mut action: Vec<f32> = planned.into_iter().map(|u| u.clamp(-1.0, 1.0) as f32).collect();
        unstick.apply(seen.is_stuck, &mut action, rng);
        action
    })
}

/// Runs one episode for `steps` steps with the task's controller on true states.
pub fn run_oracle(env: &dyn Environment, episode: &Episode, steps: usize, rng: &mut Rng) -> Vec<Step> {
    let mut oracle = env.oracle();
    walk(env, episode, steps, rng, |seen, rng| {
        let action = oracle(seen.state, &episode.goal, rng);
        action.iter().zip(env.action_limit()).map(|(u, limit)| (u / limit) as f32).collect()
    })
}

impl Unstick {
    /// Puts the rule's action in the place of the controller's where the last one changed nothing.
    fn apply(self, is_stuck: bool, action: &mut [f32], rng: &mut Rng) {
        if is_stuck && self == Self::Random {
            draw_uniformly(action, rng);
        }
    }
}

fn draw_uniformly(action: &mut [f32], rng: &mut Rng) {
    action.fill_with(|| sampling::uniform(rng, -1.0, 1.0));
}

/// What there is to act on.
struct Seen<'a> {
    state: &'a [f64],
    picture: &'a [u8],
    /// The last action changed nothing in the picture.
    is_stuck: bool,
}

fn walk(
    env: &dyn Environment,
    episode: &Episode,
    steps: usize,
    rng: &mut Rng,
    mut act: impl FnMut(&Seen<'_>, &mut Rng) -> Vec<f32>,
) -> Vec<Step> {
    let limit = env.action_limit();
    let (mut state, mut picture) = (episode.start.clone(), env.observe(&episode.before, &episode.start));
    let mut is_stuck = false;
    let mut path = Vec::with_capacity(steps);
    for _ in 0..steps {
        let action = act(&Seen { state: &state, picture: &picture, is_stuck }, rng);
        let torque: Vec<f64> = action.iter().zip(limit).map(|(&u, limit)| f64::from(u) * limit).collect();
        let next = env.step(&state, &torque, rng);
        let after = env.observe(&state, &next);
        is_stuck = after == picture;
        let before = std::mem::replace(&mut picture, after.clone());
        path.push(Step { state: std::mem::replace(&mut state, next.clone()), before, action, next, after });
    }
    path
}
