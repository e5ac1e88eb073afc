//! Transitions from uniformly random states and actions (paper, "Data Generation Procedure").

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{PresetOf, Refusal, Stage, StageCx, inputs};
use crate::{
    artifact::Transitions,
    env::Environment,
    nn::noise,
    record::{At, topic},
};

#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Params {
    /// Transitions to draw.
    samples: u64,
}

impl Default for Params {
    fn default() -> Self {
        Self { samples: 5000 }
    }
}

impl super::Params for Params {
    fn preset(_: &PresetOf<'_>) -> Self {
        Self::default()
    }

    fn check(&self) -> Vec<Refusal> {
        super::at_least_one("samples", self.samples)
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
        for sample in 0..params.samples {
            let state = env.sample_state(&mut rng);
            let action = env.sample_action(&mut rng);
            let next = env.step(&state, &action, &mut rng);
            let goal = noise::index(&mut rng, goals.len()) as u32;
            let scaled: Vec<f32> = action.iter().zip(env.action_limit()).map(|(u, limit)| (u / limit) as f32).collect();
            let (now, after) = (env.picture(&state), env.picture(&next));
            if sample % 64 == 0 {
                let at = At::new(cx.round, 0, sample);
                cx.record.picture(topic::PICTURE_COLLECTED, at, height as u32, width as u32, &now);
                cx.tick(sample, params.samples, "")?;
            }
            transitions.push(&now, &scaled, &after, goal);
        }
        Ok(transitions)
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
