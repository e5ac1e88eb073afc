//! New transitions from acting with the learned policy (paper, "Sample the environment for new real data").
//!
//! Where episodes continue from one collection to the next, the true state of the last episode is kept beside the
//! transitions. Only the next collection reads it: see [`Collected`].

use anyhow::Context as _;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{
    MOST_STEPS, Memory, Preset, PresetOf, Refusal, Stage, StageCx, controllers::Controllers, count,
    generate_data::none_yet, inputs, within,
};
use crate::{
    artifact::{Collected, TrainedModel, Transitions},
    control::{
        Acting, Agent, Controller,
        episodes::{self, Episode, Step, Streams, UnfinishedEpisode, Unstick},
    },
    env::{Simulator, Start},
    lce::Sizes,
    num::sampling,
    record::{At, Level, topic},
};

#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Params {
    /// Transitions to make; the last episode is cut short.
    samples: u64,
    /// Steps after which an episode ends; T at most.
    episode: u64,
    /// Share of an episode, or of the samples where those are fewer, that acts at random at its end where the model
    /// doubts its goal.
    explore: f64,
    /// Whether the last episode of the input `last` goes on; otherwise every collection begins at a start.
    r#continue: bool,
}

impl Default for Params {
    fn default() -> Self {
        Self { samples: 128, episode: 400, explore: 0.5, r#continue: false }
    }
}

impl super::Params for Params {
    fn preset(of: &PresetOf<'_>) -> Self {
        let horizon = of.task.spec().horizon as u64;
        // The paper's episodes follow the policy throughout.
        let explore = if of.preset == Preset::Paper { 0.0 } else { Self::default().explore };
        of.lay_task_over(Collect::KIND, Self { episode: horizon, explore, ..Self::default() })
    }

    fn check(&self) -> Vec<Refusal> {
        let mut refusals = Vec::new();
        count(&mut refusals, "samples", self.samples, 1..=MOST_STEPS);
        count(&mut refusals, "episode", self.episode, 1..=MOST_STEPS);
        within(&mut refusals, "explore", self.explore, 0.0, 1.0);
        refusals
    }

    fn memory(&self, sizes: &Sizes) -> Option<Memory> {
        Some(Memory { path: "samples", bytes: Transitions::memory(self.samples, sizes.pixels) })
    }

    fn needs(&self) -> &'static [&'static str] {
        if self.r#continue { &["last"] } else { &[] }
    }
}

inputs! {
    pub(super) struct Inputs {
        /// the encoder to see with
        model: TrainedModel,
        /// the policy to act with
        agent: Agent,
        /// the collection before, whose last episode may go on
        last: Option<Collected>,
    }
}

pub(super) struct Collect;

impl Stage for Collect {
    const KIND: &'static str = "collect";
    const VERSION: u32 = 1;
    const ABOUT: &'static str = "transitions on the policy: encoder means, sampled actions";
    type Params = Params;
    type Inputs = Inputs;
    type Output = Collected;

    fn run(params: &Params, inputs: Inputs, cx: &mut StageCx<'_>) -> anyhow::Result<Collected> {
        let (mut simulator, spec) = (cx.task.open()?, cx.task.spec());
        let mut rng = cx.rng("episodes");
        let mut transitions = none_yet(&*simulator, &spec, params.samples)?;
        // Goals follow each other in turn, from a random one on.
        let mut goal = sampling::index(&mut rng, spec.goals);
        let total = params.samples as usize;
        let mut unfinished = inputs.last.and_then(|last| last.unfinished).filter(|_| params.r#continue);
        let longest = spec.horizon.min(params.episode as usize);
        let whole = if params.r#continue { longest } else { longest.min(total) };
        let follows = ((1.0 - params.explore) * whole as f64).round() as usize;
        let suspect = &inputs.model.suspect_goals;
        if follows < whole && !suspect.is_empty() {
            announce(suspect, cx);
        }
        let controllers =
            Controllers { model: Some(&inputs.model.model), agent: Some(&inputs.agent), ilqr: None, solar: None };
        let mut policy = controllers.policy(Controller::Agent, Acting::Sample, cx.task)?;
        while transitions.len() < total {
            let done = if let Some(episode) = unfinished.take() {
                goal = episode.goal;
                simulator.restore(&episode.snapshot(), goal).context("cannot continue the last episode of `last`")?;
                episode.steps
            } else {
                goal = (goal + 1) % spec.goals;
                simulator.reset(Start::Usual, goal, &mut rng)?;
                0
            };
            let steps = longest.saturating_sub(done).min(total - transitions.len());
            let random_from = suspect.contains(&goal).then(|| follows.saturating_sub(done));
            let episode = Episode { goal, steps, unstick: Unstick::Off, random_from };
            let plans = cx.rng(("plans", transitions.len() as u64));
            let streams = Streams { acting: &mut rng, plans };
            let path = episodes::run(&mut *simulator, &mut *policy, episode, streams, |_| ())?;
            for step in &path {
                transitions.push(&step.observation, &step.action, &step.next_observation, goal as u32);
            }
            let at = At::new(cx.round, 0, transitions.len() as u64);
            if let Some(Step { next_observation, .. }) = path.last() {
                cx.picture(topic::PICTURE_COLLECTED, at, next_observation);
                let is_unfinished = params.r#continue && done + steps < longest;
                unfinished = is_unfinished.then(|| unfinished_episode(&*simulator, goal, done + steps)).transpose()?;
            }
            cx.progress(transitions.len() as u64, params.samples, "")?;
        }
        Ok(Collected { transitions, unfinished })
    }
}

/// Tells the user that exploration replaces the policy at the end of episodes to these goals.
fn announce(suspect: &[usize], cx: &mut StageCx<'_>) {
    let goals: Vec<_> = suspect.iter().map(ToString::to_string).collect();
    let sentence = format!("episodes to suspect goals ({}) end with random actions", goals.join(", "));
    cx.record.log(At::new(cx.round, 0, 0), Level::Info, &sentence);
    cx.say(&sentence);
}

/// The episode as the next collection continues it.
fn unfinished_episode(simulator: &dyn Simulator, goal: usize, steps: usize) -> anyhow::Result<UnfinishedEpisode> {
    let now = simulator.snapshot().context("the simulator does not tell its state, which `continue` needs")?;
    Ok(UnfinishedEpisode { before: now.before.clone(), state: now.state.clone(), goal, steps })
}
