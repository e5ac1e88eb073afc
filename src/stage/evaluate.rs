//! Measures an agent, iLQR, or the controller that knows true states, on episodes that every round and algorithm with
//! the same seed shares.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Preset, PresetOf, Refusal, Stage, StageCx, above_zero, inputs};
use crate::{
    artifact::{EpisodeResult, Evaluation, TrainedModel},
    control::{
        Agent, Ilqr,
        rollout::{self, Acting, Controller, Episode, Step, Unstick},
    },
    env::{Environment, Start},
    lce::LceModel,
    num::rng::Rng,
    record::{At, TrajectoryFrame, topic},
};

#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[serde(default)]
pub(super) struct Params {
    /// Who acts.
    controller: Controller,
    /// Episodes to run.
    episodes: u64,
    /// Where episodes start.
    start: Start,
    /// Largest distance from the goal state that counts as being there; an angle in tasks with poles.
    radius: f64,
    /// What to do when an action changed nothing in the picture; the policy alone is measured beside it.
    unstick: Unstick,
}

impl Default for Params {
    fn default() -> Self {
        Self { controller: Controller::Agent, episodes: 10, start: Start::Usual, radius: 5.0, unstick: Unstick::Random }
    }
}

impl super::Params for Params {
    fn preset(of: &PresetOf<'_>) -> Self {
        let env = of.task.open();
        // Two frames that stay the same show a pole at rest, which may be what is wanted.
        let off = of.preset == Preset::Paper || env.frames() > 1;
        let unstick = if off { Unstick::Off } else { Unstick::Random };
        of.lay_task_over(Evaluate::KIND, Self { radius: env.goal_radius(), unstick, ..Self::default() })
    }

    fn check(&self) -> Vec<Refusal> {
        let mut refusals = super::at_least_one("episodes", self.episodes);
        above_zero(&mut refusals, "radius", self.radius);
        refusals
    }

    fn needs(&self) -> &'static [&'static str] {
        match self.controller {
            Controller::Agent => &["model", "agent"],
            Controller::Ilqr => &["model", "ilqr"],
            Controller::Oracle => &[],
        }
    }
}

inputs! {
    pub(super) struct Inputs {
        /// the encoder to see with, and iLQR's dynamics; an oracle needs none
        model: Option<TrainedModel>,
        /// the policy to act with where the controller is an agent, by its mean action
        agent: Option<Agent>,
        /// how to plan where the controller is iLQR
        ilqr: Option<Ilqr>,
    }
}

/// Who acts, with what that takes.
#[derive(Clone, Copy)]
enum Actor<'a> {
    Agent(&'a LceModel, &'a Agent),
    Ilqr(&'a LceModel, &'a Ilqr),
    Oracle,
}

impl Inputs {
    fn actor(&self, controller: Controller) -> anyhow::Result<Actor<'_>> {
        let model = self.model.as_ref().map(|trained| &trained.model);
        match (controller, model, &self.agent, &self.ilqr) {
            (Controller::Oracle, ..) => Ok(Actor::Oracle),
            (Controller::Agent, Some(model), Some(agent), _) => Ok(Actor::Agent(model, agent)),
            (Controller::Ilqr, Some(model), _, Some(ilqr)) => Ok(Actor::Ilqr(model, ilqr)),
            (Controller::Agent, ..) => anyhow::bail!("an agent needs the inputs `model` and `agent`"),
            (Controller::Ilqr, ..) => anyhow::bail!("iLQR needs the inputs `model` and `ilqr`"),
        }
    }
}

impl Actor<'_> {
    fn run(
        self,
        env: &dyn Environment,
        episode: &Episode,
        steps: usize,
        unstick: Unstick,
        (mut acting, plans): (Rng, Rng),
    ) -> Vec<Step> {
        let rng = &mut acting;
        match self {
            Self::Agent(model, agent) => {
                rollout::run(env, (model, agent), episode, steps, (Acting::Mean, unstick), rng)
            }
            Self::Ilqr(model, ilqr) => rollout::run_ilqr(env, (model, ilqr), episode, steps, unstick, (rng, plans)),
            Self::Oracle => rollout::run_oracle(env, episode, steps, rng),
        }
    }
}

pub(super) struct Evaluate;

impl Stage for Evaluate {
    const KIND: &'static str = "evaluate";
    const VERSION: u32 = 1;
    const ABOUT: &'static str = "share of time at the goal, on episodes that all rounds share";
    const HEADLINE: Option<&'static str> = Some("percent_goal");
    type Params = Params;
    type Inputs = Inputs;
    type Output = Evaluation;

    fn run(params: &Params, inputs: Inputs, cx: &mut StageCx<'_>) -> anyhow::Result<Evaluation> {
        let env = cx.task.open();
        let steps = env.horizon() + 1;
        let count = params.episodes as usize;
        let episodes = rollout::draw_episodes(&*env, params.start, count, &mut cx.shared_rng("episodes"));
        let ceiling = env.ceiling_as(params.start);
        let goals = env.goals();
        let actor = inputs.actor(params.controller)?;
        let unstick = if params.controller == Controller::Oracle { Unstick::Off } else { params.unstick };
        let params = &Params { unstick, ..*params };
        let mut results = Vec::new();
        let mut percent_goal_t = 0.0;
        record_obstacles(&*env, cx);
        for (number, episode) in episodes.iter().enumerate() {
            let run = |unstick: Unstick| {
                let [acting, plans] = ["acting", "plans"].map(|purpose| cx.shared_rng((purpose, number as u64)));
                actor.run(&*env, episode, steps, unstick, (acting, plans))
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
            cx.progress(number as u64 + 1, params.episodes, "")?;
        }
        let mean = |of: fn(&EpisodeResult) -> f64| results.iter().map(of).sum::<f64>() / results.len() as f64;
        let (percent_goal, policy_alone) = (mean(|r| r.percent_goal), mean(|r| r.policy_alone));
        let at = At::new(cx.round, 0, 0);
        let mut curves = vec![("percent_goal", percent_goal), ("policy_alone", policy_alone)];
        curves.extend(env.paper_online().map(|percent| ("paper", percent)));
        curves.extend(ceiling.map(|percent| ("ceiling", percent)));
        cx.record.scalars(topic::PERCENT_GOAL, at, &curves);
        cx.metric("percent_goal", percent_goal);
        cx.metric("policy_alone", policy_alone);
        Ok(Evaluation {
            controller: params.controller,
            start: params.start,
            percent_goal,
            policy_alone,
            percent_goal_t,
            share_of_ceiling: ceiling.map(|ceiling| 100.0 * percent_goal / ceiling),
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
        radius: env.place_radius(params.radius),
        percent_goal: result.percent_goal,
    };
    cx.record.trajectory(topic::TRAJECTORY, At::new(cx.round, 0, number as u64), &frame);
}
