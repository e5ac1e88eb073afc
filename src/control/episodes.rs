//! Closed-loop control: one loop that runs any policy in any simulator.
//!
//! Policies see observations, never states. The oracle is the exception: it is the one policy that may read
//! [`Moment::true_state`].

use super::policy::{Goal, Moment, Policy};
use crate::{
    env::{Simulator, Snapshot},
    num::{rng::Rng, sampling},
};

/// What the loop does after an action that left the image unchanged. A deterministic policy would repeat that action for
/// ever.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Unstick {
    /// It keeps the policy's action.
    Off,
    /// It replaces the policy's next action by a uniformly random one.
    Random,
}

/// What the loop is told of an episode.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Episode {
    /// Which of the task's goals the policy is to reach.
    pub goal: usize,
    /// Control steps to run.
    pub steps: usize,
    /// The rule for actions that leave the image unchanged.
    pub unstick: Unstick,
    /// The step from which uniformly random actions replace the policy's, if any.
    pub random_from: Option<usize>,
}

/// The random streams of an episode.
#[derive(Debug)]
pub struct Streams<'a> {
    /// For the policy's actions, random replacements of them, and the simulator.
    pub acting: &'a mut Rng,
    /// For the policy's plans.
    pub plans: Rng,
}

/// One control step, as a policy could see it.
#[derive(Debug, Clone, PartialEq)]
pub struct Step {
    /// The observation before the action.
    pub observation: Vec<u8>,
    /// The action that was applied; each component is a share of its limit, in -1..1.
    pub action: Vec<f32>,
    /// The observation after the action.
    pub next_observation: Vec<u8>,
}

/// An episode that a later collection continues. It holds true states, so nothing that learns may read it.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UnfinishedEpisode {
    /// The true state one step ago.
    pub before: Vec<f64>,
    /// The true state.
    pub state: Vec<f64>,
    /// Which of the task's goals.
    pub goal: usize,
    /// Steps that are done.
    pub steps: usize,
}

impl UnfinishedEpisode {
    /// Where the simulated system is.
    pub fn snapshot(&self) -> Snapshot {
        Snapshot { before: self.before.clone(), state: self.state.clone() }
    }
}

/// Goals of `count` episodes: every goal equally often, in random order.
pub fn draw_goals(count: usize, goals: usize, rng: &mut Rng) -> Vec<usize> {
    let mut order: Vec<u32> = (0..count as u32).collect();
    sampling::shuffle(rng, &mut order);
    order.into_iter().map(|i| i as usize % goals).collect()
}

/// Runs a policy from where the simulator stands. `watch` sees the simulator after every step.
///
/// # Errors
/// Whatever keeps the simulator from working, and an action that is not finite.
pub fn run(
    simulator: &mut dyn Simulator,
    policy: &mut dyn Policy,
    episode: Episode,
    streams: Streams<'_>,
    mut watch: impl FnMut(&dyn Simulator),
) -> anyhow::Result<Vec<Step>> {
    let Streams { acting: rng, plans } = streams;
    policy.begin(Goal { index: episode.goal, image: &simulator.goal_image(episode.goal) }, plans);
    let mut observation = simulator.observe();
    let mut steps: Vec<Step> = Vec::with_capacity(episode.steps);
    for step in 0..episode.steps {
        let last = steps.last();
        let moment = Moment {
            step,
            left: episode.steps - step,
            observation: &observation,
            last_action: last.map(|last| &last.action[..]),
            true_state: simulator.snapshot().map(|now| &now.state[..]),
        };
        let mut action = policy.act(&moment, rng);
        let is_stuck = last.is_some_and(|last| last.observation == last.next_observation);
        if episode.random_from.is_some_and(|from| step >= from) {
            draw_uniformly(&mut action, rng);
        }
        if is_stuck && episode.unstick == Unstick::Random {
            draw_uniformly(&mut action, rng);
        }
        if let Some(bad) = action.iter().find(|number| !number.is_finite()) {
            anyhow::bail!("the policy's action in step {step} is {bad}: its weights are finite, but too large");
        }
        simulator.step(&action, rng)?;
        watch(simulator);
        let next_observation = simulator.observe();
        let observation = std::mem::replace(&mut observation, next_observation.clone());
        steps.push(Step { observation, action, next_observation });
    }
    Ok(steps)
}

fn draw_uniformly(action: &mut [f32], rng: &mut Rng) {
    action.fill_with(|| sampling::uniform(rng, -1.0, 1.0));
}
