//! Transitions from uniformly random states and actions (paper, "Data Generation Procedure").

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{PresetOf, Refusal, Stage, StageCx, inputs, within};
use crate::{
    artifact::Transitions,
    env::Environment,
    num::{rng::Rng, sampling},
    record::{At, topic},
};

#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Params {
    /// Transitions to draw.
    samples: u64,
    /// Transitions in a row, by random actions from one random state on; 1 draws a state for each of them.
    trajectory: u64,
    /// Where states are drawn from.
    region: Region,
    /// Share of states from the preferred part of the region `biased`, p in the paper.
    biased_share: f64,
}

/// Where states are drawn from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(super) enum Region {
    /// Everywhere.
    All,
    /// As in the paper's experiment with biased sampling: mostly where a task begins.
    Biased,
}

impl Default for Params {
    fn default() -> Self {
        Self { samples: 5000, trajectory: 1, region: Region::All, biased_share: 0.5 }
    }
}

impl super::Params for Params {
    fn preset(of: &PresetOf<'_>) -> Self {
        let general = Self { biased_share: of.task.open().biased_share(), ..Self::default() };
        of.lay_task_over(GenerateData::KIND, general)
    }

    fn check(&self) -> Vec<Refusal> {
        let mut refusals = super::at_least_one("samples", self.samples);
        refusals.extend(super::at_least_one("trajectory", self.trajectory));
        within(&mut refusals, "biased_share", self.biased_share, 0.0, 1.0);
        refusals
    }
}

inputs! {
    pub(super) struct Inputs {}
}

pub(super) struct GenerateData;

impl Stage for GenerateData {
    const KIND: &'static str = "generate_data";
    const VERSION: u32 = 1;
    const ABOUT: &'static str = "transitions from uniformly random states and actions";
    type Params = Params;
    type Inputs = Inputs;
    type Output = Transitions;

    fn run(params: &Params, _: Inputs, cx: &mut StageCx<'_>) -> anyhow::Result<Transitions> {
        let env = cx.task.open();
        let mut rng = cx.rng("transitions");
        let goals = env.goals();
        let mut transitions = none_yet(&*env);
        let (height, width) = transitions.picture;
        let (mut before, mut state) = (Vec::new(), Vec::new());
        for sample in 0..params.samples {
            if sample % params.trajectory == 0 {
                (before, state) = params.draw(&*env, &mut rng);
            }
            let action = env.sample_action(&mut rng);
            let next = env.step(&state, &action, &mut rng);
            let goal = sampling::index(&mut rng, goals.len()) as u32;
            let scaled: Vec<f32> = action.iter().zip(env.action_limit()).map(|(u, limit)| (u / limit) as f32).collect();
            let (now, after) = (env.observe(&before, &state), env.observe(&state, &next));
            if sample % 64 == 0 {
                let at = At::new(cx.round, 0, sample);
                cx.record.picture(topic::PICTURE_COLLECTED, at, height as u32, width as u32, &now);
                cx.progress(sample, params.samples, "")?;
            }
            transitions.push(&now, &scaled, &after, goal);
            (before, state) = (state, next);
        }
        Ok(transitions)
    }
}

impl Params {
    /// A random state, and the one before it: where two frames make an observation, a random action leads from a random
    /// state to the state that is meant.
    fn draw(&self, env: &dyn Environment, rng: &mut Rng) -> (Vec<f64>, Vec<f64>) {
        let drawn = match self.region {
            Region::All => env.sample_state(rng),
            Region::Biased => {
                let is_preferred = f64::from(sampling::uniform(rng, 0.0, 1.0)) < self.biased_share;
                env.sample_biased(is_preferred, rng)
            }
        };
        if env.frames() == 1 {
            return (drawn.clone(), drawn);
        }
        let action = env.sample_action(rng);
        let next = env.step(&drawn, &action, rng);
        (drawn, next)
    }
}

/// No transitions of a task, with its goal images.
pub(super) fn none_yet(env: &dyn Environment) -> Transitions {
    Transitions {
        picture: env.picture_size(),
        action_dim: env.action_limit().len(),
        goals: env.goals().iter().flat_map(|goal| env.picture(goal)).collect(),
        ..Transitions::default()
    }
}
