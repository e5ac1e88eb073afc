//! Measures an agent on episodes that every round and algorithm with the same seed shares.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Preset, PresetOf, Refusal, Stage, StageCx, above_zero, inputs};
use crate::{
    artifact::{EpisodeResult, Evaluation, TrainedModel},
    control::{
        Agent,
        rollout::{self, Acting, Step, Unstick},
    },
    env::Environment,
    record::{At, TrajectoryFrame, topic},
};

#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[serde(default)]
pub(super) struct Params {
    /// Episodes to run.
    episodes: u64,
    /// Largest distance from the goal state that counts as being there.
    radius: f64,
    /// What to do when an action changed nothing in the picture; the policy alone is measured beside it.
    unstick: Unstick,
}

impl Default for Params {
    fn default() -> Self {
        Self { episodes: 10, radius: 5.0, unstick: Unstick::Random }
    }
}

impl super::Params for Params {
    fn preset(of: &PresetOf<'_>) -> Self {
        let radius = of.task.open().goal_radius();
        let unstick = if of.preset == Preset::Paper { Unstick::Off } else { Unstick::Random };
        Self { radius, unstick, ..Self::default() }
    }

    fn check(&self) -> Vec<Refusal> {
        let mut refusals = super::at_least_one("episodes", self.episodes);
        above_zero(&mut refusals, "radius", self.radius);
        refusals
    }
}

inputs! {
    pub(super) struct Inputs {
        /// the encoder to see with
        model: TrainedModel,
        /// the policy to act with, by its mean action
        agent: Agent,
    }
}

pub(super) struct Evaluate;

impl Stage for Evaluate {
    const KIND: &'static str = "evaluate";
    const VERSION: u32 = 1;
    const ABOUT: &'static str = "share of time at the goal, on episodes that all rounds share";
    type Params = Params;
    type Inputs = Inputs;
    type Output = Evaluation;

    fn run(params: &Params, inputs: Inputs, cx: &mut StageCx<'_>) -> anyhow::Result<Evaluation> {
        let env = cx.task.open();
        let steps = env.horizon() + 1;
        let episodes = rollout::draw_episodes(&*env, params.episodes as usize, &mut cx.shared_rng("episodes"));
        let goals = env.goals();
        let controller = (&inputs.model.model, &inputs.agent);
        let mut results = Vec::new();
        let mut percent_goal_t = 0.0;
        record_obstacles(&*env, cx);
        for (number, episode) in episodes.iter().enumerate() {
            let run = |unstick: Unstick| {
                let mut rng = cx.shared_rng(("acting", number as u64));
                rollout::run(&*env, controller, episode, steps, (Acting::Mean, unstick), &mut rng)
            };
            let at_goal = |path: &[Step]| {
                let hits = path.iter().filter(|step| env.at_goal(&step.next, &episode.goal, params.radius)).count();
                100.0 * hits as f64 / path.len() as f64
            };
            let path = run(params.unstick);
            let policy_alone =
                if params.unstick == Unstick::Off { at_goal(&path) } else { at_goal(&run(Unstick::Off)) };
            percent_goal_t += at_goal(&path[..env.horizon()]) / params.episodes as f64;
            let first = path.iter().take(1).map(|step| step.state.clone());
            let result = EpisodeResult {
                goal: goals.iter().position(|goal| *goal == episode.goal).unwrap_or_default(),
                percent_goal: at_goal(&path),
                policy_alone,
                path: first.chain(path.iter().map(|step| step.next.clone())).collect(),
            };
            record_trajectory(&*env, params, &goals[result.goal], number, &result, cx);
            results.push(result);
            cx.tick(number as u64 + 1, params.episodes, "")?;
        }
        let mean = |of: fn(&EpisodeResult) -> f64| results.iter().map(of).sum::<f64>() / results.len() as f64;
        let (percent_goal, policy_alone) = (mean(|r| r.percent_goal), mean(|r| r.policy_alone));
        let at = At::new(cx.round, 0, 0);
        cx.record.scalars(
            topic::PERCENT_GOAL,
            at,
            &[
                ("percent_goal", percent_goal),
                ("policy_alone", policy_alone),
                ("paper", env.paper_online()),
                ("ceiling", env.ceiling()),
            ],
        );
        cx.figure("percent_goal", percent_goal);
        cx.figure("policy_alone", policy_alone);
        Ok(Evaluation {
            percent_goal,
            policy_alone,
            percent_goal_t,
            share_of_ceiling: 100.0 * percent_goal / env.ceiling(),
            unstick: params.unstick,
            radius: params.radius,
            horizon: env.horizon(),
            episodes: results,
        })
    }
}

fn record_obstacles(env: &dyn Environment, cx: &mut StageCx<'_>) {
    let circles = env.obstacles();
    if !circles.is_empty() {
        cx.record.obstacles(topic::OBSTACLES, At::new(cx.round, 0, 0), &circles);
    }
}

fn record_trajectory(
    env: &dyn Environment,
    params: &Params,
    goal: &[f64],
    number: usize,
    result: &EpisodeResult,
    cx: &mut StageCx<'_>,
) {
    let path: Vec<[f32; 2]> = result.path.iter().map(|state| env.place(state)).collect();
    let frame = TrajectoryFrame {
        episode: number as u32,
        path: &path,
        goal: env.place(goal),
        radius: env.place(&[params.radius; 2])[0],
        percent_goal: result.percent_goal,
    };
    cx.record.trajectory(topic::TRAJECTORY, At::new(cx.round, 0, number as u64), &frame);
}
