//! The kinds of work that a pipeline can name, and the contract that each of them keeps.
//!
//! A kind is one file here, named after itself, and one line in [`registry`].

mod collect;
mod control_ilqr;
mod cx;
mod distill_policy;
mod evaluate;
mod export_latent_map;
mod generate_data;
mod inputs;
mod networks;
mod probe;
mod state;
mod summarize;
mod train_lce;
mod train_sac;

use anyhow::Context as _;
use serde::{Serialize, de::DeserializeOwned};
use serde_json::Value;

use crate::{
    artifact::{Artifact, Files},
    env::Task,
};

pub use crate::env::Preset;
pub use cx::{Host, Interrupted, StageCx};
pub(crate) use inputs::inputs;
pub use inputs::{Arity, InputFiles, Inputs, Port, PortField, load_port};
pub use networks::network_sizes;
pub use state::StageState;

/// One kind of stage: typed parameters and inputs in, one artifact out.
///
/// Nothing but parameters, inputs and `cx.rng` may reach the output: no clock, no path, no thread count.
pub trait Stage: 'static {
    /// The `kind` that pipeline files write.
    const KIND: &'static str;
    /// Raised when the same parameters and inputs would give other bytes.
    const VERSION: u32;
    /// One line for `carl-pipe stages`.
    const ABOUT: &'static str;
    /// The metric that models are judged by, where this stage measures one model: tables, charts and the closing line
    /// of a run show it. `None` for every other stage.
    const HEADLINE: Option<&'static str> = None;
    /// What the pipeline file may set.
    type Params: Params;
    /// What other stages hand in.
    type Inputs: Inputs;
    /// What this stage hands on.
    type Output: Artifact;

    /// Does the work.
    fn run(params: &Self::Params, inputs: Self::Inputs, cx: &mut StageCx<'_>) -> anyhow::Result<Self::Output>;
}

/// The parameters of a kind. Derive `Serialize`, `Deserialize` (with `deny_unknown_fields, default`) and `JsonSchema`:
/// field documentation becomes help text, and what a file leaves out comes from [`Params::preset`].
pub trait Params: Serialize + DeserializeOwned + Default + schemars::JsonSchema {
    /// The values of a preset for a task.
    fn preset(of: &PresetOf<'_>) -> Self;

    /// Refuses values out of range, each by its path (`lambda.consistency`) and what is wrong with it.
    fn check(&self) -> Vec<Refusal> {
        Vec::new()
    }

    /// Optional inputs that these parameters cannot do without.
    fn needs(&self) -> &'static [&'static str] {
        &[]
    }
}

/// The parameters of a kind that has none.
#[derive(Debug, Default, Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct NoParams {}

impl Params for NoParams {
    fn preset(_: &PresetOf<'_>) -> Self {
        Self::default()
    }
}

/// A parameter that cannot be used.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Refusal {
    /// The parameter's path below the stage, such as `lambda.consistency`.
    pub path: &'static str,
    /// A lower-case clause such as ``must be above 0, but is `-1` ``.
    pub why: String,
}

/// Refuses a value that is not above zero; nan and inf are refused too.
pub fn above_zero(refusals: &mut Vec<Refusal>, path: &'static str, value: f64) {
    if !(value.is_finite() && value > 0.0) {
        refusals.push(Refusal { path, why: format!("must be above 0, but is `{value}`") });
    }
}

/// Refuses a value outside `low..=high`; nan and inf are refused too.
pub fn within(refusals: &mut Vec<Refusal>, path: &'static str, value: f64, low: f64, high: f64) {
    if !(value.is_finite() && (low..=high).contains(&value)) {
        refusals.push(Refusal { path, why: format!("must lie in {low}..{high}, but is `{value}`") });
    }
}

/// Refuses a count of zero.
pub fn at_least_one(path: &'static str, value: u64) -> Vec<Refusal> {
    if value == 0 { vec![Refusal { path, why: "must be at least 1".to_owned() }] } else { Vec::new() }
}

/// What a preset may depend on.
#[derive(Debug)]
pub struct PresetOf<'a> {
    /// Which table.
    pub preset: Preset,
    /// The task of the pipeline.
    pub task: &'a Task,
    /// The parameters written in the file, since `objective` decides over other defaults.
    pub given: &'a serde_json::Map<String, Value>,
}

impl PresetOf<'_> {
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

/// Puts the entries of a table in the place of those of another one; tables in both are merged.
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

/// A kind with its types erased: what the pipeline checks against and the engine runs.
pub struct Kind {
    /// See [`Stage::KIND`].
    pub name: &'static str,
    /// See [`Stage::VERSION`].
    pub version: u32,
    /// See [`Stage::ABOUT`].
    pub about: &'static str,
    /// See [`Stage::HEADLINE`].
    pub headline: Option<&'static str>,
    /// The inputs it takes.
    pub ports: &'static [Port],
    /// The type of its artifact.
    pub output: &'static str,
    /// All parameters of a preset, explicit.
    pub preset: fn(&PresetOf<'_>) -> Value,
    /// The JSON schema of its parameters, with their documentation.
    pub schema: fn() -> schemars::Schema,
    /// Writes parameters the one way that equal values have: `7` for a float becomes `7.0`, keys take their order.
    pub canonical: fn(&Value) -> Result<Value, serde_json::Error>,
    /// Reads explicit parameters and refuses those out of range.
    pub check: fn(&Value) -> Result<Vec<Refusal>, serde_json::Error>,
    /// Optional inputs that explicit parameters cannot do without.
    pub needs: fn(&Value) -> Result<&'static [&'static str], serde_json::Error>,
    /// Does the work: explicit parameters and verified files in, files out.
    pub run: fn(&Value, &InputFiles<'_>, &mut StageCx<'_>) -> anyhow::Result<Files>,
}

impl std::fmt::Debug for Kind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Kind({} v{})", self.name, self.version)
    }
}

impl Kind {
    /// Erases the types of `S`.
    pub fn of<S: Stage>() -> Self {
        Self {
            name: S::KIND,
            version: S::VERSION,
            about: S::ABOUT,
            headline: S::HEADLINE,
            ports: S::Inputs::PORTS,
            output: S::Output::TYPE,
            preset: |of| serde_json::to_value(S::Params::preset(of)).expect("parameters are plain data"),
            schema: || schemars::schema_for!(S::Params),
            canonical: |params| serde_json::to_value(serde_json::from_value::<S::Params>(params.clone())?),
            check: |params| serde_json::from_value::<S::Params>(params.clone()).map(|params| params.check()),
            needs: |params| serde_json::from_value::<S::Params>(params.clone()).map(|params| params.needs()),
            run: |params, inputs, cx| {
                let params: S::Params = serde_json::from_value(params.clone())?;
                let inputs = S::Inputs::load(inputs)?;
                let output = S::run(&params, inputs, cx)?;
                output.save().with_context(|| format!("cannot lay out {}", S::Output::TYPE))
            },
        }
    }
}

/// Every kind there is, in the order of a pipeline.
pub fn registry() -> &'static [Kind] {
    static KINDS: std::sync::LazyLock<Vec<Kind>> = std::sync::LazyLock::new(|| {
        vec![
            Kind::of::<generate_data::GenerateData>(),
            Kind::of::<collect::Collect>(),
            Kind::of::<train_lce::TrainLce>(),
            Kind::of::<distill_policy::DistillPolicy>(),
            Kind::of::<train_sac::TrainSac>(),
            Kind::of::<control_ilqr::ControlIlqr>(),
            Kind::of::<evaluate::Evaluate>(),
            Kind::of::<export_latent_map::ExportLatentMap>(),
            Kind::of::<summarize::Summarize>(),
        ]
    });
    &KINDS
}

/// The kind called `name`.
pub fn kind(name: &str) -> Option<&'static Kind> {
    registry().iter().find(|kind| kind.name == name)
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::env;

    /// Whether `whole` has every entry of `part`, with a number equal to `7` where `part` has `7.0`.
    fn contains(whole: &Value, part: &Value) -> bool {
        match (whole, part) {
            (Value::Object(whole), Value::Object(part)) => {
                part.iter().all(|(name, part)| whole.get(name).is_some_and(|whole| contains(whole, part)))
            }
            (Value::Number(whole), Value::Number(part)) => whole.as_f64() == part.as_f64(),
            (whole, part) => whole == part,
        }
    }

    #[test]
    fn every_kind_accepts_and_takes_the_defaults_of_every_task() {
        for task_kind in env::registry() {
            let task: Task = serde_json::from_value(json!({ "env": task_kind.name })).unwrap();
            for kind in registry() {
                for objective in ["carl", "pcc", "value_guided"] {
                    for preset in [Preset::Recipe, Preset::Paper] {
                        let given = json!({ "objective": objective });
                        let given = given.as_object().unwrap();
                        let params = (kind.preset)(&PresetOf { preset, task: &task, given });
                        let declared = task.defaults(kind.name, preset, given);
                        let place = format!("{} of {} for {objective}: {declared}", kind.name, task.name());
                        assert!(contains(&params, &declared), "{place} in {params}");
                        assert_eq!((kind.check)(&params).unwrap(), [], "{place}");
                    }
                }
            }
        }
    }
}
