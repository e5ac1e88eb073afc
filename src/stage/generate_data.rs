//! Transitions from uniformly random states and actions (paper, "Data Generation Procedure").

use anyhow::Context as _;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{MOST_STEPS, Memory, PresetOf, Refusal, Stage, StageCx, count, inputs, within};
use crate::{
    artifact::Transitions,
    env::{Simulator, Snapshot, Spec, Start, System},
    lce::Sizes,
    num::{rng::Rng, sampling},
    record::{At, topic},
};

#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Params {
    /// Transitions to draw.
    samples: u64,
    /// Transitions that follow each other by random actions. Each such trajectory begins in a random state, or at the
    /// start of an episode in tasks that draw no states.
    trajectory: u64,
    /// Where states are drawn from.
    region: Region,
    /// The most steps for which a random action is held; their number is random, too. An action that is held swings what
    /// an action of one step only shakes.
    #[serde(skip_serializing_if = "is_one")]
    hold: u64,
}

/// Actions of one step stand in no key.
#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde hands in a reference")]
fn is_one(hold: &u64) -> bool {
    *hold == 1
}

/// Where states are drawn from.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(super) enum Region {
    /// All states.
    All,
    /// The two regions of the paper's experiment with biased sampling; the preferred one is mostly where a task begins.
    Biased(Bias),
}

/// How much more often biased sampling draws from the preferred region.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Bias {
    /// Share of states from the preferred region; p in the paper.
    preferred_share: f64,
}

impl Default for Bias {
    fn default() -> Self {
        Self { preferred_share: 0.5 }
    }
}

impl Default for Params {
    fn default() -> Self {
        Self { samples: 5000, trajectory: 1, region: Region::All, hold: 1 }
    }
}

impl super::Params for Params {
    fn preset(of: &PresetOf<'_>) -> Self {
        of.lay_task_over(GenerateData::KIND, Self::default())
    }

    fn check(&self) -> Vec<Refusal> {
        let mut refusals = Vec::new();
        count(&mut refusals, "samples", self.samples, 1..=MOST_STEPS);
        count(&mut refusals, "trajectory", self.trajectory, 1..=MOST_STEPS);
        count(&mut refusals, "hold", self.hold, 1..=MOST_STEPS);
        if let Region::Biased(Bias { preferred_share }) = self.region {
            within(&mut refusals, "region.biased.preferred_share", preferred_share, 0.0, 1.0);
        }
        refusals
    }

    fn memory(&self, sizes: &Sizes) -> Option<Memory> {
        Some(Memory { path: "samples", bytes: Transitions::memory(self.samples, sizes.pixels) })
    }
}

inputs! {
    pub(super) struct Inputs {}
}

pub(super) struct GenerateData;

impl Stage for GenerateData {
    const KIND: &'static str = "generate_data";
    /// 2: the share of the preferred region stands under `region`; same output.
    const VERSION: u32 = 2;
    const ABOUT: &'static str = "transitions from uniformly random states and actions";
    type Params = Params;
    type Inputs = Inputs;
    type Output = Transitions;

    fn run(params: &Params, _: Inputs, cx: &mut StageCx<'_>) -> anyhow::Result<Transitions> {
        let (mut simulator, spec) = (cx.task.open()?, cx.task.spec());
        let states = States { system: cx.task.system(), task: cx.task.name(), spec: &spec, params };
        let mut rng = cx.rng("transitions");
        let mut transitions = none_yet(&*simulator, &spec, params.samples)?;
        let (mut action, mut held) = (Vec::new(), 0);
        for sample in 0..params.samples {
            if sample % params.trajectory == 0 {
                states.enter(&mut *simulator, &mut rng)?;
                held = 0;
            }
            if held == 0 {
                action = random_action(&spec, &mut rng);
                held = if params.hold > 1 { 1 + sampling::index(&mut rng, params.hold as usize) } else { 1 };
            }
            held -= 1;
            let observation = simulator.observe();
            simulator.step(&action, &mut rng)?;
            let goal = sampling::index(&mut rng, spec.goals) as u32;
            if sample % 64 == 0 {
                let at = At::new(cx.round, 0, sample);
                cx.picture(topic::PICTURE_COLLECTED, at, &observation);
                cx.progress(sample, params.samples, "")?;
            }
            transitions.push(&observation, &action, &simulator.observe(), goal);
        }
        Ok(transitions)
    }
}

/// Where trajectories begin.
struct States<'a> {
    system: Option<Box<dyn System>>,
    task: &'a str,
    spec: &'a Spec,
    params: &'a Params,
}

impl States<'_> {
    /// Puts the simulator where the next trajectory begins: into a random state, or at the start of an episode where
    /// states cannot be drawn.
    fn enter(&self, simulator: &mut dyn Simulator, rng: &mut Rng) -> anyhow::Result<()> {
        let Some(drawn) = self.draw(rng)? else { return simulator.reset(Start::Usual, 0, rng) };
        enter_state(simulator, self.spec, drawn, 0, rng)
    }

    fn draw(&self, rng: &mut Rng) -> anyhow::Result<Option<Vec<f64>>> {
        let (task, system) = (self.task, self.system.as_ref());
        if let Region::Biased(Bias { preferred_share }) = self.params.region {
            let is_preferred = f64::from(sampling::uniform(rng, 0.0, 1.0)) < preferred_share;
            let state = system.and_then(|system| system.sample_biased(is_preferred, rng));
            return state.map(Some).with_context(|| format!("`{task}` has no region for `region = \"biased\"`"));
        }
        let state = system.and_then(|system| system.sample_state(rng));
        anyhow::ensure!(
            state.is_some() || self.params.trajectory > 1,
            "`{task}` does not draw random states, so transitions must follow an episode: set `trajectory` above 1"
        );
        Ok(state)
    }
}

/// Puts the simulator into a random state, in an episode towards this goal.
pub(super) fn enter_state(
    simulator: &mut dyn Simulator,
    spec: &Spec,
    drawn: Vec<f64>,
    goal: usize,
    rng: &mut Rng,
) -> anyhow::Result<()> {
    simulator.restore(&Snapshot::at_rest(drawn), goal)?;
    if spec.frames.count > 1 {
        // A random action leads from the random state to the state that is meant, so that two frames show a velocity.
        simulator.step(&random_action(spec, rng), rng)?;
    }
    Ok(())
}

/// A uniformly random action; each component is a share of its limit.
fn random_action(spec: &Spec, rng: &mut Rng) -> Vec<f32> {
    spec.action_limit.iter().map(|_| sampling::uniform(rng, -1.0, 1.0)).collect()
}

/// No transitions of a task, with its goal images and with memory for `samples` transitions.
pub(super) fn none_yet(simulator: &dyn Simulator, spec: &Spec, samples: u64) -> anyhow::Result<Transitions> {
    let mut transitions = Transitions {
        picture: spec.frames.observation(),
        action_dim: spec.action_limit.len(),
        goals: (0..spec.goals).flat_map(|goal| simulator.goal_image(goal)).collect(),
        ..Transitions::default()
    };
    let reserved = transitions.reserve(samples as usize);
    reserved.with_context(|| format!("no memory for {samples} transitions: lower `samples`"))?;
    Ok(transitions)
}
