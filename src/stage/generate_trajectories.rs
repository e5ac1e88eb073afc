//! Whole episodes: of random actions (paper, "Data Generation Procedure": SOLAR's trajectories), or of a policy.

use anyhow::Context as _;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{
    MOST_STEPS, Memory, PresetOf, Refusal, Stage, StageCx, above_zero, count,
    generate_data::enter_state,
    inputs,
    state_cost::{Distance, Observer},
};
use crate::{
    artifact::{Trajectories, Transitions},
    control::{
        Acting, Goal, Moment, Policy, SolarPolicy,
        episodes::{self, Episode, Streams, Unstick},
    },
    env::{Simulator, Start},
    lce::Sizes,
    num::{rng::Rng, sampling},
    record::{At, topic},
    solar::SolarController,
};

#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Params {
    /// Steps to make, in whole episodes of T steps: as many episodes as fit, one at least.
    samples: u64,
    /// Where episodes begin.
    begin: Begin,
    /// The start of an episode that begins there.
    start: Start,
    /// How actions are drawn where no policy acts.
    actions: RandomActions,
    /// The cost of every step that is observed.
    costs: ObservedCosts,
}

/// Where episodes begin.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(super) enum Begin {
    /// At the start, as in the paper.
    Start,
    /// In a random state, where the data of the other algorithms begin.
    Anywhere,
}

/// How the actions of an episode are drawn.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(super) enum RandomActions {
    /// Uniformly within the limits, as the paper's text says.
    Uniform,
    /// From a Gaussian without correlation, clipped to the limits.
    Gaussian(Gaussian),
}

/// A Gaussian of mean 0.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Gaussian {
    /// Standard deviation as a share of the limit of the action.
    std: f64,
}

impl Default for Gaussian {
    fn default() -> Self {
        Self { std: 0.5 }
    }
}

/// The cost of a step that is observed beside its picture.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(super) enum ObservedCosts {
    /// None.
    None,
    /// The distance of the true state from the goal: more than the other algorithms get. For an upper baseline.
    TrueState(Distance),
}

impl Default for Params {
    fn default() -> Self {
        Self {
            samples: 5000,
            begin: Begin::Start,
            start: Start::Usual,
            actions: RandomActions::Uniform,
            costs: ObservedCosts::None,
        }
    }
}

impl super::Params for Params {
    fn preset(of: &PresetOf<'_>) -> Self {
        of.lay_task_over(GenerateTrajectories::KIND, Self::default())
    }

    fn check(&self) -> Vec<Refusal> {
        let mut refusals = Vec::new();
        count(&mut refusals, "samples", self.samples, 1..=MOST_STEPS);
        if let RandomActions::Gaussian(Gaussian { std }) = self.actions {
            above_zero(&mut refusals, "actions.gaussian.std", std);
        }
        if let ObservedCosts::TrueState(distance) = self.costs {
            distance.check("costs.true_state.state_cost", "costs.true_state.action_cost", &mut refusals);
        }
        refusals
    }

    fn memory(&self, sizes: &Sizes) -> Option<Memory> {
        Some(Memory { path: "samples", bytes: Transitions::memory(self.samples, sizes.pixels) / 2 })
    }
}

inputs! {
    pub(super) struct Inputs {
        /// the policy that acts, with its noise; without one, actions are random
        solar: Option<SolarController>,
    }
}

pub(super) struct GenerateTrajectories;

impl Stage for GenerateTrajectories {
    const KIND: &'static str = "generate_trajectories";
    const VERSION: u32 = 1;
    const ABOUT: &'static str = "whole episodes of random actions or of a policy, for SOLAR";
    type Params = Params;
    type Inputs = Inputs;
    type Output = Trajectories;

    fn run(params: &Params, inputs: Inputs, cx: &mut StageCx<'_>) -> anyhow::Result<Trajectories> {
        let (mut simulator, spec) = (cx.task.open()?, cx.task.spec());
        let observer = match params.costs {
            ObservedCosts::None => None,
            ObservedCosts::TrueState(distance) => Some(Observer::new(cx.task, distance)?),
        };
        let mut policy: Box<dyn Policy> = match &inputs.solar {
            Some(SolarController { networks, plans }) => Box::new(SolarPolicy::new(networks, plans, Acting::Sample)),
            None => Box::new(RandomPolicy { actions: params.actions, action_dim: spec.action_limit.len() }),
        };
        let mut rng = cx.rng("trajectories");
        let mut made = Trajectories {
            picture: spec.frames.observation(),
            action_dim: spec.action_limit.len(),
            goals: (0..spec.goals).flat_map(|goal| simulator.goal_image(goal)).collect(),
            ..Trajectories::default()
        };
        let count = (params.samples as usize / spec.horizon).max(1);
        let reserved = made.observations.try_reserve_exact((count * spec.horizon).saturating_mul(made.pixels()));
        reserved.with_context(|| format!("no memory for {} steps: lower `samples`", params.samples))?;
        for number in 0..count {
            let goal = number % spec.goals;
            params.begin(&mut *simulator, goal, &mut rng, cx)?;
            let mut states: Vec<Vec<f64>> = simulator.snapshot().into_iter().map(|now| now.state.clone()).collect();
            let episode = Episode { goal, steps: spec.horizon, unstick: Unstick::Off, random_from: None };
            let streams = Streams { acting: &mut rng, plans: cx.rng("plans") };
            let path = episodes::run(&mut *simulator, &mut *policy, episode, streams, |simulator| {
                states.extend(simulator.snapshot().map(|now| now.state.clone()));
            })?;
            for step in &path {
                made.observations.extend_from_slice(&step.observation);
                made.actions.extend_from_slice(&step.action);
            }
            if let Some(observer) = &observer {
                let costs = path.iter().zip(&states).map(|(step, state)| observer.cost(state, goal, &step.action));
                made.costs.extend(costs);
            }
            made.end_episode(goal as u32);
            let at = At::new(cx.round, 0, ((number + 1) * spec.horizon) as u64);
            cx.picture(topic::PICTURE_COLLECTED, at, &simulator.observe());
            cx.progress(number as u64 + 1, count as u64, "")?;
        }
        cx.metric("samples", (count * spec.horizon) as f64);
        Ok(made)
    }
}

impl Params {
    /// Puts the simulator where an episode begins.
    fn begin(&self, simulator: &mut dyn Simulator, goal: usize, rng: &mut Rng, cx: &StageCx<'_>) -> anyhow::Result<()> {
        simulator.reset(self.start, goal, rng)?;
        if self.begin == Begin::Anywhere {
            let (name, system, spec) = (cx.task.name(), cx.task.system(), cx.task.spec());
            let state = system.as_ref().and_then(|system| system.sample_state(rng));
            let state = state.with_context(|| format!("`{name}` does not draw random states: leave out `begin`"))?;
            enter_state(simulator, &spec, state, goal, rng)?;
        }
        Ok(())
    }
}

/// Acts at random.
struct RandomPolicy {
    actions: RandomActions,
    action_dim: usize,
}

impl Policy for RandomPolicy {
    fn begin(&mut self, _: Goal<'_>, _: Rng) {}

    fn act(&mut self, _: &Moment<'_>, rng: &mut Rng) -> Vec<f32> {
        match self.actions {
            RandomActions::Uniform => (0..self.action_dim).map(|_| sampling::uniform(rng, -1.0, 1.0)).collect(),
            RandomActions::Gaussian(Gaussian { std }) => {
                let mut noise = vec![0.0_f32; self.action_dim];
                sampling::fill_normal(rng, &mut noise);
                noise.iter().map(|noise| (noise * std as f32).clamp(-1.0, 1.0)).collect()
            }
        }
    }
}
