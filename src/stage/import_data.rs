//! Transitions that another program recorded.

mod episodes;
mod pictures;

use std::path::{Component, Path};

use anyhow::{Context as _, ensure};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{NamedFile, Outside, PresetOf, Refusal, Stage, StageCx, above_zero, inputs};
use crate::{
    arrays::{self, Array, Arrays},
    artifact::Transitions,
    digest::Digest,
    env::Spec,
    record::{At, topic},
};
use episodes::Pairs;
use pictures::Pictures;

#[derive(Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Params {
    /// A `.npz` or `.safetensors` file, or a folder of PNG files with `actions.csv`. The path counts from the folder of the
    /// pipeline file; the content is part of the key.
    file: String,
    /// The names that the arrays have in the file.
    #[serde(default)]
    names: Names,
    /// The largest absolute value of each component of an action in the file; one number for all. Actions are divided by it.
    #[serde(default = "one")]
    action_limit: Vec<f64>,
    /// The grey value from 0 to 255 from which on a pixel is white. Without it, pixels of a task in black and white must be
    /// one or the other.
    #[serde(default)]
    threshold: Option<u8>,
    /// What was found outside of the pipeline file.
    #[serde(default)]
    #[schemars(skip)]
    found: Option<Digest>,
}

fn one() -> Vec<f64> {
    vec![1.0]
}

/// The names of the arrays of a file.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
struct Names {
    /// Pictures before the actions.
    observations: String,
    /// Actions.
    actions: String,
    /// Pictures after the actions. Without this array, the picture after an action is the next one of its episode.
    next_observations: String,
    /// Arrays that are true at the last step of an episode, each where the file has it.
    ends: Vec<String>,
    /// Pictures of goals. Without this array, the goals are those of the task.
    goals: String,
    /// The number of the goal of each transition. Without this array, every transition has the first goal.
    goal_index: String,
}

impl Default for Names {
    fn default() -> Self {
        let ends = ["ends", "terminals", "timeouts", "terminations", "truncations"];
        Self {
            observations: "observations".to_owned(),
            actions: "actions".to_owned(),
            next_observations: "next_observations".to_owned(),
            ends: ends.map(str::to_owned).to_vec(),
            goals: "goals".to_owned(),
            goal_index: "goal_index".to_owned(),
        }
    }
}

impl super::Params for Params {
    const NAMES_OUTSIDE: bool = true;

    fn preset(_: &PresetOf<'_>) -> Self {
        Self { action_limit: one(), ..Self::default() }
    }

    fn check(&self) -> Vec<Refusal> {
        let mut refusals = Vec::new();
        let path = Path::new(&self.file);
        if !arrays::is_known(path) && path.components().next_back() != Some(Component::ParentDir) {
            let help = "write a `.npz` or `.safetensors` file, or a folder of PNG files with `actions.csv`";
            refusals.push(Refusal::new("file", "has an unknown ending").help(help));
        }
        self.action_limit.iter().for_each(|&limit| above_zero(&mut refusals, "action_limit", limit));
        refusals
    }

    fn complete(&mut self, outside: &dyn Outside) -> Vec<Refusal> {
        match outside.digest(&self.file) {
            Ok(content) => {
                self.found = Some(content);
                Vec::new()
            }
            Err(why) => vec![Refusal::new("file", format!("cannot be read: {why}"))],
        }
    }

    fn files(&self) -> Vec<NamedFile> {
        self.found.iter().map(|&content| NamedFile { path: self.file.clone(), content }).collect()
    }
}

inputs! {
    pub(super) struct Inputs {}
}

pub(super) struct ImportData;

impl Stage for ImportData {
    const KIND: &'static str = "import_data";
    const VERSION: u32 = 1;
    const ABOUT: &'static str = "transitions that another program recorded";
    const REPEATS: bool = false;
    type Params = Params;
    type Inputs = Inputs;
    type Output = Transitions;

    fn run(params: &Params, _: Inputs, cx: &mut StageCx<'_>) -> anyhow::Result<Transitions> {
        let content = params.found.context("the content of the file is not known")?;
        let path = cx.file(content)?;
        let spec = cx.task.spec();
        let transitions = read(params, &*arrays::open(&path, Path::new(&params.file))?, &spec, cx)
            .with_context(|| format!("cannot import `{}`", params.file))?;
        let (count, pixels) = (transitions.len(), transitions.pixels());
        for sample in (0..count).step_by(count.div_ceil(8).max(1)) {
            let picture = &transitions.observations[sample * pixels..][..pixels];
            cx.picture(topic::PICTURE_COLLECTED, At::new(cx.round, 0, sample as u64), picture);
        }
        cx.metric("samples", count as f64);
        Ok(transitions)
    }
}

/// Reads and checks all arrays.
fn read(params: &Params, file: &dyn Arrays, spec: &Spec, cx: &StageCx<'_>) -> anyhow::Result<Transitions> {
    let Params { names, .. } = params;
    let known = file.names();
    let optional = |name: &String| known.contains(name).then(|| file.read(name)).transpose();
    let required = |name: &String| optional(name)?.with_context(|| no_array(name, &known));
    let observations = Pictures::new(required(&names.observations)?, spec.frames, params.threshold);
    let observations = observations.with_context(|| format!("`{}`", names.observations))?;
    let actions = actions(&required(&names.actions)?, spec, &params.action_limit);
    let actions = actions.with_context(|| format!("`{}`", names.actions))?;
    let after = optional(&names.next_observations)?;
    let after = after.map(|after| Pictures::new(after, spec.frames, params.threshold)).transpose();
    let after = after.with_context(|| format!("`{}`", names.next_observations))?;
    let ends =
        names.ends.iter().filter_map(|name| optional(name).transpose()).collect::<anyhow::Result<Vec<Array>>>()?;
    let dimension = spec.action_limit.len();
    let pairs = Pairs { observations, after, ends, steps: actions.len() / dimension }.find()?;
    let mut transitions = Transitions {
        picture: spec.frames.observation(),
        action_dim: dimension,
        goals: goals(optional(&names.goals)?, spec, params.threshold, cx)
            .with_context(|| format!("`{}`", names.goals))?,
        ..Transitions::default()
    };
    transitions.reserve(pairs.len()).with_context(|| format!("no memory for {} transitions", pairs.len()))?;
    let goal_count = transitions.goals.len() / transitions.pixels();
    let goal_index = optional(&names.goal_index)?;
    let goal_index = goal_index.map(|array| array.numbers().collect::<Vec<f64>>());
    for pair in pairs {
        let goal = goal_index.as_ref().map_or(Some(0.0), |all| all.get(pair.step).copied());
        let goal = goal.filter(|goal| goal.fract() == 0.0 && (0.0..goal_count as f64).contains(goal));
        let goal = goal.with_context(|| {
            format!("`{}` has no goal from 0 to {} at index {}", names.goal_index, goal_count - 1, pair.step)
        })?;
        let action = &actions[pair.step * dimension..][..dimension];
        transitions.push(&pair.before, action, &pair.after, goal as u32);
    }
    ensure!(!transitions.is_empty(), "the file has no transitions");
    Ok(transitions)
}

fn no_array(name: &str, known: &[String]) -> String {
    let shown: Vec<String> = known.iter().take(12).map(|name| format!("`{name}`")).collect();
    format!("no array `{name}`; the file has {}; set `names` to say which is which", shown.join(", "))
}

/// Actions from -1 to 1.
fn actions(array: &Array, spec: &Spec, limits: &[f64]) -> anyhow::Result<Vec<f32>> {
    let dimension = spec.action_limit.len();
    let fits = match array.shape[..] {
        [_] => dimension == 1,
        [_, own] => own == dimension,
        _ => false,
    };
    ensure!(fits, "the shape is {:?}, but the task has actions of {dimension} components", array.shape);
    ensure!(
        limits.len() == 1 || limits.len() == dimension,
        "`action_limit` has {} numbers for actions of {dimension} components",
        limits.len()
    );
    let limit = |at: usize| limits[if limits.len() == 1 { 0 } else { at % dimension }];
    let scaled = array.numbers().enumerate().map(|(at, number)| {
        let action = (number / limit(at)) as f32;
        ensure!(
            action.abs() <= 1.0,
            "number {number} at index {} is beyond its limit of {}: set `action_limit`",
            at / dimension,
            limit(at)
        );
        Ok(action)
    });
    scaled.collect()
}

/// The pictures of goals: those of the file, or else those of the task.
fn goals(array: Option<Array>, spec: &Spec, threshold: Option<u8>, cx: &StageCx<'_>) -> anyhow::Result<Vec<u8>> {
    let Some(array) = array else {
        let simulator = cx.task.open()?;
        return Ok((0..spec.goals).flat_map(|goal| simulator.goal_image(goal)).collect());
    };
    let goals = Pictures::new(array, spec.frames, threshold)?;
    ensure!(goals.len() > 0, "there is no goal");
    (0..goals.len())
        .map(|goal| goals.observation(goal, goal))
        .collect::<anyhow::Result<Vec<_>>>()
        .map(|all| all.concat())
}
