//! A kind of stage without its Rust types, and the registry of all kinds.

use anyhow::Context as _;
use serde_json::Value;

use super::{
    ANY, Declared, InputFiles, Inputs as _, Memory, NamedFile, Outside, Params, Port, PresetOf, Refusal, Stage,
    StageCx, collect, command, control_ilqr, control_solar, declared, distill_policy, divergence, evaluate,
    export_latent_map, generate_data, generate_trajectories, import_data, memory, network_sizes, summarize, train_lce,
    train_sac, train_solar,
};
use crate::{
    artifact::{Artifact as _, Files, must_be_finite},
    env::Task,
};

/// A kind of stage without its Rust types: the pipeline checks files against it, and the scheduler runs it.
pub struct Kind {
    /// See [`Stage::KIND`].
    pub name: &'static str,
    /// See [`Stage::VERSION`].
    pub version: u32,
    /// See [`Stage::ABOUT`].
    pub about: &'static str,
    /// See [`Stage::HEADLINE`].
    pub headline: Option<&'static str>,
    /// See [`Stage::REPEATS`].
    pub repeats: bool,
    /// The inputs it takes.
    pub ports: &'static [Port],
    /// The type of its artifact; see [`Artifact::TYPE`].
    pub output: &'static str,
    /// See [`Artifact::READABLE_AS`].
    pub readable_as: &'static [&'static str],
    /// The values of all parameters under a preset.
    pub preset: fn(&PresetOf<'_>) -> Value,
    /// The JSON schema of the parameters, with their documentation.
    pub schema: fn() -> schemars::Schema,
    /// Writes equal parameters as equal JSON: `7` for a float becomes `7.0`, and keys take the order of the fields.
    pub canonical: fn(&Value) -> Result<Value, serde_json::Error>,
    /// The parameters that are out of range, or ask for too much memory in a task. All parameters are given.
    pub check: fn(&Value, &Task) -> Result<Vec<Refusal>, serde_json::Error>,
    /// The optional inputs that the parameters need. All parameters are given.
    pub needs: fn(&Value) -> Result<&'static [&'static str], serde_json::Error>,
    /// See [`Params::complete`].
    pub complete: fn(Value, &dyn Outside) -> serde_json::Result<Completed>,
    /// See [`Params::files`].
    pub files: fn(&Value) -> Result<Vec<NamedFile>, serde_json::Error>,
    /// For a kind whose inputs and output each stage declares: what a stage with these parameters, and inputs of these
    /// names, declares. See [`Kind::declared`].
    pub declare: Option<fn(&Value, &[&str]) -> Declared>,
    /// Does the work. Takes all parameters and the verified files of the inputs, and returns the files of the output.
    pub run: Run,
}

/// Parameters with what was found outside, and what was not found.
pub type Completed = (Value, Vec<Refusal>);

/// See [`Kind::run`].
pub type Run = fn(&Value, &InputFiles<'_>, &mut StageCx<'_>) -> anyhow::Result<Files>;

impl std::fmt::Debug for Kind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Kind({} v{})", self.name, self.version)
    }
}

impl Kind {
    /// Whether a port that takes `artifact` can read this kind's output.
    pub fn gives(&self, artifact: &str) -> bool {
        artifact == ANY || self.output == artifact || self.readable_as.contains(&artifact)
    }

    /// The kind as a stage with these parameters, and inputs of these names, uses it. That is the kind itself, unless its
    /// stages declare their own inputs and output.
    pub fn declared<'k, 'p>(&'k self, params: &Value, inputs: impl IntoIterator<Item = &'p str>) -> &'k Self {
        declared::declared(self, params, inputs)
    }

    /// The kind `S` without its Rust types.
    pub fn of<S: Stage>() -> Self {
        Self {
            headline: S::HEADLINE,
            repeats: S::REPEATS,
            ports: S::Inputs::PORTS,
            readable_as: S::Output::READABLE_AS,
            ..Self::with::<S::Params>(S::KIND, S::VERSION, S::ABOUT, S::Output::TYPE, run::<S>)
        }
    }

    /// A kind with these parameters and without inputs.
    pub(super) fn with<P: Params>(
        name: &'static str,
        version: u32,
        about: &'static str,
        output: &'static str,
        run: Run,
    ) -> Self {
        Self {
            name,
            version,
            about,
            headline: None,
            repeats: true,
            ports: &[],
            output,
            readable_as: &[],
            preset: |of| serde_json::to_value(P::preset(of)).expect("parameters are plain data"),
            schema: || schemars::schema_for!(P),
            canonical: |params| serde_json::to_value(serde_json::from_value::<P>(params.clone())?),
            check: |params, task| serde_json::from_value(params.clone()).map(|params| check::<P>(&params, task)),
            needs: |params| serde_json::from_value::<P>(params.clone()).map(|params| params.needs()),
            complete: |params, outside| {
                if !P::NAMES_OUTSIDE {
                    return Ok((params, Vec::new()));
                }
                let mut params: P = serde_json::from_value(params)?;
                let refusals = params.complete(outside);
                Ok((serde_json::to_value(params)?, refusals))
            },
            files: |params| match P::NAMES_OUTSIDE {
                true => serde_json::from_value::<P>(params.clone()).map(|params| params.files()),
                false => Ok(Vec::new()),
            },
            declare: None,
            run,
        }
    }
}

fn check<P: Params>(params: &P, task: &Task) -> Vec<Refusal> {
    let mut refusals = params.check();
    refusals.extend(params.symmetries().into_iter().flat_map(|symmetries| symmetries.refusals(task)));
    // A value that is out of range asks for no sensible amount.
    if refusals.is_empty() {
        refusals.extend(params.memory(&network_sizes(task)).and_then(Memory::refusal));
    }
    refusals
}

/// Runs a stage on a machine with memory for it. Neither its headline metric nor its files hold a number that is not finite.
fn run<S: Stage>(params: &Value, inputs: &InputFiles<'_>, cx: &mut StageCx<'_>) -> anyhow::Result<Files> {
    let typed: S::Params = serde_json::from_value(params.clone())?;
    memory::must_fit(typed.memory(&network_sizes(cx.task)), inputs.bytes()?, memory::of_this_machine())?;
    let inputs = S::Inputs::load(inputs)?;
    let made = S::run(&typed, inputs, cx);
    let output = made.map_err(|error| divergence::with_cause::<S::Params>(error, params, cx.task))?;
    if let Some(headline) = S::HEADLINE {
        anyhow::ensure!(!cx.is_not_finite(headline), "the metric `{headline}` is not finite");
    }
    let files = output.save().with_context(|| format!("cannot lay out {}", S::Output::TYPE))?;
    must_be_finite(&files, S::Output::MAY_BE_MISSING)?;
    Ok(files)
}

/// The kinds that come with the program, in the order of a pipeline.
pub fn registry() -> &'static [Kind] {
    static KINDS: std::sync::LazyLock<Vec<Kind>> = std::sync::LazyLock::new(built_in);
    &KINDS
}

/// The kinds that come with the program, and own ones after them. It allocates for the life of the process, so call it
/// once.
pub fn registry_with(own: Vec<Kind>) -> &'static [Kind] {
    let mut kinds = built_in();
    kinds.extend(own);
    kinds.leak()
}

fn built_in() -> Vec<Kind> {
    vec![
        Kind::of::<generate_data::GenerateData>(),
        Kind::of::<generate_trajectories::GenerateTrajectories>(),
        Kind::of::<import_data::ImportData>(),
        Kind::of::<collect::Collect>(),
        Kind::of::<train_lce::TrainLce>(),
        Kind::of::<distill_policy::DistillPolicy>(),
        Kind::of::<train_sac::TrainSac>(),
        Kind::of::<control_ilqr::ControlIlqr>(),
        Kind::of::<train_solar::TrainSolar>(),
        Kind::of::<control_solar::ControlSolar>(),
        Kind::of::<evaluate::Evaluate>(),
        Kind::of::<export_latent_map::ExportLatentMap>(),
        Kind::of::<summarize::Summarize>(),
        command::kind(),
    ]
}

/// The kind called `name`.
pub fn kind(name: &str) -> Option<&'static Kind> {
    registry().iter().find(|kind| kind.name == name)
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::{
        env::{self, World},
        stage::Preset,
    };

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

    /// A task in another process, as a manifest holds it.
    fn programs_task() -> Task {
        let about = json!({
            "height": 64, "width": 64, "channels": 3, "shades": true, "frames": 2, "action_low": [0.0], "action_high": [1.0],
            "horizon": 200, "goals": 1, "states": 0,
        });
        let found = json!({ "files": {}, "versions": {}, "about": about });
        serde_json::from_value(json!({ "env": "process", "command": ["./it"], "found": found })).unwrap()
    }

    #[test]
    fn every_kind_accepts_and_takes_the_defaults_of_every_task() {
        for task_kind in env::registry() {
            let task: Task = match task_kind.world {
                World::Process => programs_task(),
                _ => serde_json::from_value(json!({ "env": task_kind.name })).unwrap(),
            };
            for kind in registry() {
                for objective in ["carl", "pcc", "pc3", "e2c", "rce", "value_guided"] {
                    for preset in [Preset::Recipe, Preset::Paper] {
                        let given = json!({ "objective": objective, "region": "biased" });
                        let given = given.as_object().unwrap();
                        let params = (kind.preset)(&PresetOf { preset, task: &task, given });
                        let declared = task.defaults(kind.name, preset, given);
                        let place = format!("{} of {} for {objective}: {declared}", kind.name, task.name());
                        assert!(contains(&params, &declared), "{place} in {params}");
                        assert_eq!((kind.check)(&params, &task).unwrap(), [], "{place}");
                    }
                }
            }
        }
    }
}
