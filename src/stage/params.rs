//! The parameters of a kind: their defaults, and the values that are refused.

use std::{borrow::Cow, ops::RangeInclusive};

use serde::{Serialize, de::DeserializeOwned};
use serde_json::Value;

use super::{Memory, NamedFile, Outside, Preset, StepScale, Symmetries};
use crate::{env::Task, lce::Sizes};

/// The parameters of a kind. Derive `Serialize`, `Deserialize` (with `deny_unknown_fields, default`) and `JsonSchema`.
/// The documentation of the fields becomes help text. [`Params::preset`] fills the parameters that a file leaves out.
pub trait Params: Serialize + DeserializeOwned + Default + schemars::JsonSchema {
    /// The parameters that scale a training step. Where training diverges, one of them is named as the likely cause.
    const STEP_SCALES: &'static [StepScale] = &[];

    /// The values of a preset for a task.
    fn preset(of: &PresetOf<'_>) -> Self;

    /// The values that are out of range.
    fn check(&self) -> Vec<Refusal> {
        Vec::new()
    }

    /// The symmetries of the task that are applied. A name that the task does not declare is refused.
    fn symmetries(&self) -> Option<&Symmetries> {
        None
    }

    /// The memory that these parameters ask for, with networks of these widths. More than
    /// [`MOST_MEMORY`](super::MOST_MEMORY) is refused.
    fn memory(&self, _: &Sizes) -> Option<Memory> {
        None
    }

    /// The optional inputs that these parameters need.
    fn needs(&self) -> &'static [&'static str] {
        &[]
    }

    /// Whether parameters of the kind name anything outside of the pipeline file. Only then [`Params::complete`] and
    /// [`Params::files`] are called: a plan of thousands of nodes need not read all parameters once more.
    const NAMES_OUTSIDE: bool = false;

    /// Adds what lies outside of the pipeline file and yet changes the result, such as the content of files that the
    /// parameters name. It becomes part of the key. Returns what cannot be found.
    fn complete(&mut self, _: &dyn Outside) -> Vec<Refusal> {
        Vec::new()
    }

    /// The files that the completed parameters name.
    fn files(&self) -> Vec<NamedFile> {
        Vec::new()
    }
}

/// The parameters of a kind without parameters.
#[derive(Debug, Default, Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct NoParams {}

impl Params for NoParams {
    fn preset(_: &PresetOf<'_>) -> Self {
        Self::default()
    }
}

/// A parameter that is out of range.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Refusal {
    /// The parameter's path below the stage, such as `lambda.consistency`.
    pub path: Cow<'static, str>,
    /// A lower-case clause such as ``must be above 0, but is `-1` ``.
    pub why: String,
    /// What the user can do, if `why` does not say it.
    pub help: Option<String>,
}

impl Refusal {
    /// Refuses the parameter at `path`.
    pub fn new(path: impl Into<Cow<'static, str>>, why: impl Into<String>) -> Self {
        Self { path: path.into(), why: why.into(), help: None }
    }

    /// The same refusal with a help text.
    #[must_use]
    pub fn help(self, help: impl Into<String>) -> Self {
        Self { help: Some(help.into()), ..self }
    }
}

/// Refuses a value that is not above zero, nan and inf among them.
pub fn above_zero(refusals: &mut Vec<Refusal>, path: &'static str, value: f64) {
    if !(value.is_finite() && value > 0.0) {
        refusals.push(Refusal::new(path, format!("must be above 0, but is `{value}`")));
    }
}

/// Refuses a value outside `low..=high`, nan and inf among them.
pub fn within(refusals: &mut Vec<Refusal>, path: impl Into<Cow<'static, str>>, value: f64, low: f64, high: f64) {
    if !(value.is_finite() && (low..=high).contains(&value)) {
        refusals.push(Refusal::new(path, format!("must lie in {low}..{high}, but is `{value}`")));
    }
}

/// Refuses a count outside a range.
pub fn count(refusals: &mut Vec<Refusal>, path: &'static str, value: u64, range: RangeInclusive<u64>) {
    let (fewest, most) = range.into_inner();
    if value < fewest {
        refusals.push(Refusal::new(path, format!("must be at least {fewest}")));
    } else if value > most {
        refusals.push(Refusal::new(path, format!("must be at most {most}, but is `{value}`")));
    }
}

/// The most steps, samples and the like that a parameter may ask for. They cost time; memory has a bound of its own.
pub const MOST_STEPS: u64 = 1_000_000_000;
/// The most passes over the data that a parameter may ask for.
pub const MOST_PASSES: u64 = 1_000_000;
/// The most symmetric copies of the transitions that a parameter may ask for.
pub const MOST_COPIES: u64 = 100;

/// What the defaults of a kind may depend on.
#[derive(Debug)]
pub struct PresetOf<'a> {
    /// Which table of defaults.
    pub preset: Preset,
    /// The task of the pipeline.
    pub task: &'a Task,
    /// The parameters that the file writes. A choice such as `objective` decides over other defaults.
    pub given: &'a serde_json::Map<String, Value>,
}

impl PresetOf<'_> {
    /// The choice that the file writes for a parameter, such as `objective`.
    pub fn chosen(&self, parameter: &str) -> Option<&str> {
        crate::env::chosen(self.given, parameter)
    }

    /// Lays the defaults that the task declares for the kind `stage` over the kind's general ones.
    ///
    /// # Panics
    /// If the task declares a default that the kind does not accept.
    pub fn lay_task_over<P: Params>(&self, stage: &str, general: P) -> P {
        let mut values = serde_json::to_value(general).expect("parameters are plain data");
        lay_over(&mut values, self.task.defaults(stage, self.preset, self.given));
        let accepted = serde_json::from_value(values);
        let task = self.task.name();
        accepted.unwrap_or_else(|error| panic!("the task `{task}` declares a wrong default for `{stage}`: {error}"))
    }
}

/// Replaces entries of the table `below` by those of `above`. Tables in both are merged.
fn lay_over(below: &mut Value, above: Value) {
    match (below, above) {
        (Value::Object(below), Value::Object(above)) => {
            for (name, value) in above {
                lay_over(below.entry(name).or_insert(Value::Null), value);
            }
        }
        (below, above) => *below = above,
    }
}
