//! A kind of stage that counts lit pixels: one file, and one line in `main`.

use carl_pipe::{
    artifact::{Artifact, Files, Transitions},
    inputs,
    stage::{Params, PresetOf, Stage, StageCx},
};
use serde::{Deserialize, Serialize};

/// What the pipeline file may set.
#[derive(Debug, Default, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Transitions that are left out at the beginning.
    skip: u64,
}

impl Params for Settings {
    fn preset(_: &PresetOf<'_>) -> Self {
        Self::default()
    }
}

inputs! {
    pub struct Inputs {
        /// the observations to count in
        transitions: Vec<Transitions>,
    }
}

/// The mean number of lit pixels of an observation.
pub struct MeanLit(f64);

impl Artifact for MeanLit {
    const TYPE: &'static str = "mean_lit";

    fn save(self) -> anyhow::Result<Files> {
        Ok(Files::from([("mean_lit.json".to_owned(), serde_json::to_vec(&self.0)?)]))
    }

    fn load(files: &Files) -> anyhow::Result<Self> {
        Ok(Self(serde_json::from_slice(&files.bytes("mean_lit.json")?)?))
    }
}

/// The kind `count_lit`.
pub struct CountLit;

impl Stage for CountLit {
    const KIND: &'static str = "count_lit";
    const VERSION: u32 = 1;
    const ABOUT: &'static str = "the mean number of lit pixels of an observation";
    type Params = Settings;
    type Inputs = Inputs;
    type Output = MeanLit;

    fn run(settings: &Settings, inputs: Inputs, cx: &mut StageCx<'_>) -> anyhow::Result<MeanLit> {
        let transitions = Transitions::concat(&inputs.transitions)?;
        let observations = transitions.observations.chunks(transitions.pixels()).skip(settings.skip as usize);
        let counts: Vec<usize> = observations.map(|x| x.iter().filter(|&&pixel| pixel > 0).count()).collect();
        anyhow::ensure!(!counts.is_empty(), "`skip` leaves no transitions");
        let mean = counts.iter().sum::<usize>() as f64 / counts.len() as f64;
        cx.metric("mean_lit", mean);
        Ok(MeanLit(mean))
    }
}
