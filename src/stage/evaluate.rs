//! Measures a controller on episodes that every round and algorithm with the same seed shares.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{
    Preset, PresetOf, Refusal, Stage, StageCx, above_zero,
    controllers::{self, Controllers},
    count, inputs,
    one_goal::OneGoal,
};
use crate::{
    artifact::{EpisodeResult, Evaluation, TrainedModel},
    control::{
        Acting, Agent, Controller, Ilqr, Policy,
        episodes::{self, Episode, Streams, Unstick},
    },
    env::{Simulator, Start, System},
    num::rng::Rng,
    record::{At, TrajectoryFrame, topic},
    solar::SolarController,
};

#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[serde(default)]
pub(super) struct Params {
    /// The controller that is measured.
    controller: Controller,
    /// Episodes to run.
    episodes: u64,
    /// Where episodes start.
    start: Start,
    /// Largest distance from the goal state that counts as being there; an angle in tasks with poles.
    radius: f64,
    /// What happens after an action that left the image unchanged. The policy alone is measured, too.
    unstick: Unstick,
    /// The goals of the episodes.
    #[serde(skip_serializing_if = "Goals::is_all")]
    goals: Goals,
}

/// The goals that an evaluation draws from.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(super) enum Goals {
    /// Every goal of the task equally often, in random order.
    #[default]
    All,
    /// One goal.
    Only(OneGoal),
}

impl Goals {
    #[allow(clippy::trivially_copy_pass_by_ref, reason = "serde hands in a reference")]
    fn is_all(&self) -> bool {
        *self == Self::All
    }

    /// The goal of every episode, of those that the task has.
    fn draw(self, episodes: usize, goals: usize, rng: &mut Rng) -> anyhow::Result<Vec<usize>> {
        let drawn = episodes::draw_goals(episodes, goals, rng);
        let Self::Only(goal) = self else { return Ok(drawn) };
        Ok(vec![goal.number(goals)?; episodes])
    }
}

impl Default for Params {
    fn default() -> Self {
        Self {
            controller: Controller::Agent,
            episodes: 10,
            start: Start::Usual,
            radius: 5.0,
            unstick: Unstick::Random,
            goals: Goals::All,
        }
    }
}

impl super::Params for Params {
    fn preset(of: &PresetOf<'_>) -> Self {
        let spec = of.task.spec();
        // Two frames that stay the same show a pole at rest, which may be what is wanted.
        let off = of.preset == Preset::Paper || spec.frames.count > 1;
        let unstick = if off { Unstick::Off } else { Unstick::Random };
        of.lay_task_over(Evaluate::KIND, Self { radius: spec.goal_radius, unstick, ..Self::default() })
    }

    fn check(&self) -> Vec<Refusal> {
        let mut refusals = Vec::new();
        // Every state of every episode is kept.
        count(&mut refusals, "episodes", self.episodes, 1..=100_000);
        above_zero(&mut refusals, "radius", self.radius);
        refusals
    }

    fn needs(&self) -> &'static [&'static str] {
        controllers::needs(self.controller)
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
        /// the controller, where it is SOLAR's
        solar: Option<SolarController>,
    }
}

impl Inputs {
    fn controllers(&self) -> Controllers<'_> {
        let model = self.model.as_ref().map(|trained| &trained.model);
        Controllers { model, agent: self.agent.as_ref(), ilqr: self.ilqr.as_ref(), solar: self.solar.as_ref() }
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
        let spec = cx.task.spec();
        let unstick = if params.controller == Controller::Oracle { Unstick::Off } else { params.unstick };
        let params = &Params { unstick, ..*params };
        let mut trial = Trial {
            simulator: cx.task.open()?,
            policy: inputs.controllers().policy(params.controller, Acting::Mean, cx.task)?,
            params,
            steps: spec.horizon + 1,
        };
        let scene = Scene { system: cx.task.system() };
        scene.record_obstacles(cx);
        // Two equal streams: the policy alone starts where the policy with the rule starts.
        let [mut starts, mut starts_alone] = [(); 2].map(|()| cx.shared_rng("episodes"));
        let drawn =
            [&mut starts, &mut starts_alone].map(|rng| params.goals.draw(params.episodes as usize, spec.goals, rng));
        let [goals, _] = drawn;
        let goals = goals?;
        let (mut results, mut percent_goal_t) = (Vec::new(), 0.0);
        for (number, goal) in goals.into_iter().enumerate() {
            let path = trial.run(number, goal, params.unstick, &mut starts, cx)?;
            let policy_alone = match params.unstick {
                Unstick::Off => percent(&path.is_at_goal),
                Unstick::Random => percent(&trial.run(number, goal, Unstick::Off, &mut starts_alone, cx)?.is_at_goal),
            };
            percent_goal_t += percent(&path.is_at_goal[..spec.horizon]) / params.episodes as f64;
            let percent_goal = percent(&path.is_at_goal);
            let result = EpisodeResult { goal, percent_goal, policy_alone, path: path.states };
            scene.record_trajectory(number, &result, params.radius, cx);
            results.push(result);
            cx.progress(number as u64 + 1, params.episodes, "")?;
        }
        let mean = |of: fn(&EpisodeResult) -> f64| results.iter().map(of).sum::<f64>() / results.len() as f64;
        let (percent_goal, policy_alone) = (mean(|r| r.percent_goal), mean(|r| r.policy_alone));
        let ceiling = cx.task.ceiling_of(params.start).filter(|_| params.goals.is_all());
        record_percent_goal(percent_goal, policy_alone, ceiling, cx);
        Ok(Evaluation {
            controller: params.controller,
            start: params.start,
            percent_goal,
            policy_alone,
            percent_goal_t,
            share_of_ceiling: ceiling.map(|ceiling| 100.0 * percent_goal / ceiling),
            unstick: params.unstick,
            radius: params.radius,
            horizon: spec.horizon,
            episodes: results,
        })
    }
}

fn record_percent_goal(percent_goal: f64, policy_alone: f64, ceiling: Option<f64>, cx: &mut StageCx<'_>) {
    let mut curves = vec![("percent_goal", percent_goal), ("policy_alone", policy_alone)];
    curves.extend(cx.task.paper_online().map(|percent| ("paper", percent)));
    curves.extend(ceiling.map(|percent| ("ceiling", percent)));
    cx.record.scalars(topic::PERCENT_GOAL, At::new(cx.round, 0, 0), &curves);
    cx.metric("percent_goal", percent_goal);
    cx.metric("policy_alone", policy_alone);
}

/// A policy in a simulator, ready for one episode after the other.
struct Trial<'a> {
    simulator: Box<dyn Simulator>,
    policy: Box<dyn Policy + 'a>,
    params: &'a Params,
    steps: usize,
}

/// What an episode gave.
struct Path {
    /// Whether the state after each step is at the goal.
    is_at_goal: Vec<bool>,
    /// The start and the state after each step; empty where the simulator does not tell its states.
    states: Vec<Vec<f64>>,
}

impl Trial<'_> {
    /// Runs an episode whose start is drawn from `starts`.
    fn run(
        &mut self,
        number: usize,
        goal: usize,
        unstick: Unstick,
        starts: &mut Rng,
        cx: &StageCx<'_>,
    ) -> anyhow::Result<Path> {
        let simulator = &mut *self.simulator;
        simulator.reset(self.params.start, goal, starts)?;
        let state = |simulator: &dyn Simulator| simulator.snapshot().map(|now| now.state.clone());
        let mut path = Path { is_at_goal: Vec::new(), states: state(simulator).into_iter().collect() };
        let [mut acting, plans] = ["acting", "plans"].map(|purpose| cx.shared_rng((purpose, number as u64)));
        let episode = Episode { goal, steps: self.steps, unstick, random_from: None };
        let streams = Streams { acting: &mut acting, plans };
        episodes::run(simulator, &mut *self.policy, episode, streams, |simulator| {
            path.is_at_goal.push(simulator.is_at_goal(self.params.radius));
            path.states.extend(state(simulator));
        })?;
        Ok(path)
    }
}

fn percent(is_at_goal: &[bool]) -> f64 {
    let hits = is_at_goal.iter().filter(|&&hit| hit).count();
    100.0 * hits as f64 / is_at_goal.len() as f64
}

/// Records where episodes go, in tasks whose states have a position.
struct Scene {
    system: Option<Box<dyn System>>,
}

impl Scene {
    fn record_obstacles(&self, cx: &mut StageCx<'_>) {
        let circles = self.system.as_ref().map(|system| system.obstacles()).unwrap_or_default();
        if !circles.is_empty() {
            cx.record.obstacles(topic::OBSTACLES, At::new(cx.round, 0, 0), &circles);
        }
    }

    fn record_trajectory(&self, number: usize, result: &EpisodeResult, radius: f64, cx: &mut StageCx<'_>) {
        let Some(system) = &self.system else { return };
        let path: Option<Vec<[f32; 2]>> = result.path.iter().map(|state| system.place(state)).collect();
        let goal = system.place(&system.goals()[result.goal]);
        let Some((path, goal)) = path.zip(goal) else { return };
        let radius = system.place_radius(radius);
        let frame =
            TrajectoryFrame { episode: number as u32, path: &path, goal, radius, percent_goal: result.percent_goal };
        cx.record.trajectory(topic::TRAJECTORY, At::new(cx.round, 0, number as u64), &frame);
    }
}
