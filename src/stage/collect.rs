//! New transitions from acting with what was learned (paper, "Sample the environment for new real data").

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Preset, PresetOf, Refusal, Stage, StageCx, generate_data::none_yet, inputs};
use crate::{
    artifact::{TrainedModel, Transitions},
    control::{
        Agent,
        rollout::{self, Acting, Episode, Unstick},
    },
    env::EnvName,
    nn::noise,
    record::{At, topic},
};

#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Params {
    /// Transitions to make; the last episode is cut short.
    samples: u64,
    /// Steps after which an episode ends; T at most.
    episode: u64,
}

impl Default for Params {
    fn default() -> Self {
        Self { samples: 128, episode: 400 }
    }
}

impl super::Params for Params {
    fn preset(of: &PresetOf<'_>) -> Self {
        let horizon = of.task.open().horizon() as u64;
        // What has fallen, or left the picture, shows nothing more.
        let falls = of.preset == Preset::Recipe && of.task.env == EnvName::CartPole;
        Self { episode: if falls { 60 } else { horizon }, ..Self::default() }
    }

    fn check(&self) -> Vec<Refusal> {
        let mut refusals = super::at_least_one("samples", self.samples);
        refusals.extend(super::at_least_one("episode", self.episode));
        refusals
    }
}

inputs! {
    pub(super) struct Inputs {
        /// the encoder to see with
        model: TrainedModel,
        /// the policy to act with
        agent: Agent,
    }
}

pub(super) struct Collect;

impl Stage for Collect {
    const KIND: &'static str = "collect";
    const VERSION: u32 = 1;
    const ABOUT: &'static str = "transitions on the policy: encoder means, sampled actions, fresh starts";
    type Params = Params;
    type Inputs = Inputs;
    type Output = Transitions;

    fn run(params: &Params, inputs: Inputs, cx: &mut StageCx<'_>) -> anyhow::Result<Transitions> {
        let env = cx.task.open();
        let mut rng = cx.rng("episodes");
        let goals = env.goals();
        let mut transitions = none_yet(&*env);
        let (height, width) = transitions.picture;
        // Every goal in turn, from a random one on.
        let mut goal = noise::index(&mut rng, goals.len());
        let total = params.samples as usize;
        let longest = env.horizon().min(params.episode as usize);
        while transitions.len() < total {
            goal = (goal + 1) % goals.len();
            let episode = Episode { start: env.sample_start(&mut rng), goal: goals[goal].clone() };
            let steps = longest.min(total - transitions.len());
            let controller = (&inputs.model.model, &inputs.agent);
            let path = rollout::run(&*env, controller, &episode, steps, (Acting::Sample, Unstick::Off), &mut rng);
            for step in &path {
                transitions.push(&step.before, &step.action, &step.after, goal as u32);
            }
            let at = At::new(cx.round, 0, transitions.len() as u64);
            if let Some(last) = path.last() {
                cx.record.picture(topic::PICTURE_COLLECTED, at, height as u32, width as u32, &last.after);
            }
            cx.tick(transitions.len() as u64, params.samples, "")?;
        }
        Ok(transitions)
    }
}
