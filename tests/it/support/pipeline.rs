//! Kinds that look like the real ones and do nothing, and how the tests load a pipeline with them.

#![allow(dead_code, reason = "each test uses its part")]

use std::sync::LazyLock;

use carl_pipe::{
    artifact::{Artifact, Files},
    diag::Diagnostics,
    pipeline::{Graph, Node, Overrides, Source, load},
    stage::{Inputs, Kind, Params, Port, PortField, Preset, PresetOf, Refusal, Stage, StageCx, above_zero},
};
use serde::{Deserialize, Serialize};

macro_rules! artifacts {
    ($($name:ident = $text:literal),* $(,)?) => { $(
        pub struct $name;
        impl Artifact for $name {
            const TYPE: &'static str = $text;
            fn save(self) -> anyhow::Result<Files> { Ok(Files::new()) }
            fn load(_: &Files) -> anyhow::Result<Self> { Ok(Self) }
        }
    )* };
}
artifacts!(
    Transitions = "transitions",
    LceModel = "lce_model",
    Agent = "agent",
    Evaluation = "evaluation",
    LatentMap = "latent_map",
    Table = "table",
);

macro_rules! kind {
    ($name:ident = $kind:literal -> $output:ty, $params:ty, { $($port:ident : $ty:ty),* $(,)? }) => {
        pub struct $name;
        const _: () = {
            pub struct Taken;
            impl Inputs for Taken {
                const PORTS: &'static [Port] = &[ $( Port {
                    name: stringify!($port),
                    artifact: <$ty as PortField>::ARTIFACT,
                    arity: <$ty as PortField>::ARITY,
                    about: concat!("the ", stringify!($port)),
                } ),* ];
                fn load(_: &carl_pipe::stage::InputFiles<'_>) -> anyhow::Result<Self> { Ok(Self) }
            }
            impl Stage for $name {
                const KIND: &'static str = $kind;
                const VERSION: u32 = 1;
                const ABOUT: &'static str = concat!("Does what ", $kind, " does");
                type Params = $params;
                type Inputs = Taken;
                type Output = $output;
                fn run(_: &$params, _: Taken, _: &mut StageCx<'_>) -> anyhow::Result<$output> {
                    anyhow::bail!("a test kind does not run")
                }
            }
        };
    };
}

#[derive(Debug, Default, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Nothing {}
impl Params for Nothing {
    fn preset(_: &PresetOf<'_>) -> Self {
        Self {}
    }
}

#[derive(Debug, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Samples {
    /// How many transitions.
    pub samples: u64,
}
impl Default for Samples {
    fn default() -> Self {
        Self { samples: 128 }
    }
}
impl Params for Samples {
    fn preset(_: &PresetOf<'_>) -> Self {
        Self::default()
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Objective {
    /// Prediction, consistency, curvature.
    Pcc,
    /// With the policy's error.
    Carl,
}

#[derive(Debug, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Lambda {
    /// Weight of the consistency term.
    pub consistency: f64,
    /// Weight of the curvature term.
    pub curvature: f64,
}
impl Default for Lambda {
    fn default() -> Self {
        Self { consistency: 7.0, curvature: 1.0 }
    }
}

#[derive(Debug, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Training {
    /// Which losses are minimised.
    pub objective: Objective,
    /// Passes over the transitions.
    pub epochs: u64,
    /// Adam step size.
    pub learning_rate: f64,
    /// Weights of the loss terms.
    pub lambda: Lambda,
}
impl Default for Training {
    fn default() -> Self {
        Self { objective: Objective::Pcc, epochs: 20, learning_rate: 0.0005, lambda: Lambda::default() }
    }
}
impl Params for Training {
    fn preset(of: &PresetOf<'_>) -> Self {
        let mut training = Self::default();
        if of.given.get("objective").is_some_and(|objective| objective == "carl") {
            training.lambda.consistency = 8.0;
        }
        if of.preset == Preset::Paper {
            training.epochs = 2000;
        }
        training
    }
    fn check(&self) -> Vec<Refusal> {
        let mut refusals = Vec::new();
        above_zero(&mut refusals, "learning_rate", self.learning_rate);
        above_zero(&mut refusals, "lambda.consistency", self.lambda.consistency);
        if self.epochs == 666 {
            refusals.push(Refusal::new("lambda.curvature", "does not go with 666 epochs"));
        }
        refusals
    }
}

#[derive(Debug, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Episodes {
    /// Control tasks to try.
    pub episodes: u32,
}
impl Default for Episodes {
    fn default() -> Self {
        Self { episodes: 10 }
    }
}
impl Params for Episodes {
    fn preset(_: &PresetOf<'_>) -> Self {
        Self::default()
    }
}

kind!(GenerateData = "generate_data" -> Transitions, Samples, {});
kind!(Collect = "collect" -> Transitions, Samples, { model: LceModel, agent: Agent });
kind!(TrainLce = "train_lce" -> LceModel, Training, {
    transitions: Vec<Transitions>, warm_start: Option<LceModel>, agent: Option<Agent>,
});
kind!(DistillPolicy = "distill_policy" -> Agent, Nothing, {
    transitions: Vec<Transitions>, model: LceModel, old_model: LceModel, old_agent: Agent,
});
kind!(TrainSac = "train_sac" -> Agent, Nothing, {
    transitions: Vec<Transitions>, model: LceModel, start: Option<Agent>,
});
kind!(Evaluate = "evaluate" -> Evaluation, Episodes, { model: LceModel, agent: Agent });
kind!(ExportLatentMap = "export_latent_map" -> LatentMap, Nothing, { model: LceModel });
kind!(Summarize = "summarize" -> Table, Nothing, { evaluations: Vec<Evaluation> });

pub fn kinds() -> &'static [Kind] {
    static KINDS: LazyLock<Vec<Kind>> = LazyLock::new(|| {
        vec![
            Kind::of::<GenerateData>(),
            Kind::of::<TrainLce>(),
            Kind::of::<DistillPolicy>(),
            Kind::of::<TrainSac>(),
            Kind::of::<Collect>(),
            Kind::of::<Evaluate>(),
            Kind::of::<ExportLatentMap>(),
            Kind::of::<Summarize>(),
        ]
    });
    &KINDS
}

pub fn overrides(set: &[&str], sweep: &[&str]) -> Overrides {
    let owned = |texts: &[&str]| texts.iter().map(|text| (*text).to_owned()).collect();
    Overrides { set: owned(set), sweep: owned(sweep) }
}

pub fn try_load(text: &str, set: &[&str], sweep: &[&str]) -> Result<Graph, Diagnostics> {
    load(&Source::new("p.toml", text), &overrides(set, sweep), kinds())
}

/// Loads a pipeline that is right.
pub fn graph(text: &str) -> Graph {
    graph_with(text, &[], &[])
}

pub fn graph_with(text: &str, set: &[&str], sweep: &[&str]) -> Graph {
    try_load(text, set, sweep).unwrap_or_else(|mistakes| panic!("{}", mistakes.render(false)))
}

pub fn node<'a>(graph: &'a Graph, name: &str) -> &'a Node {
    let names = || graph.nodes.iter().map(|node| node.name.as_str()).collect::<Vec<_>>();
    graph.nodes.iter().find(|node| node.name == name).unwrap_or_else(|| panic!("no {name} in {:?}", names()))
}

/// The names of what a node takes through a port.
pub fn taken<'a>(graph: &'a Graph, name: &str, port: &str) -> Vec<&'a str> {
    let (_, nodes) = node(graph, name).inputs.iter().find(|(known, _)| known.name == port).expect("a port");
    nodes.iter().map(|at| graph.nodes[*at].name.as_str()).collect()
}

/// The example of the design.
pub const ONLINE: &str = r#"schema = 1
name = "planar_online"
description = "Online CARL on planar navigation (paper, Table 1)"
seed = 0
preset = "recipe"

[task]
env = "planar"

[loop]
rounds = 17

[stages.bootstrap]
kind = "generate_data"
samples = 1024

[stages.collect]               # round i acts with what round i-1 learned
kind = "collect"
loop = { from = 1 }
inputs = { model = "represent@prev", agent = "control@prev" }
samples = 128

[stages.represent]
kind = "train_lce"
loop = true
inputs = { transitions = ["bootstrap", "collect@sofar"], warm_start = "represent@prev" }
objective = "carl"
epochs = 15
first = { epochs = 400 }

[stages.distill]
kind = "distill_policy"
loop = { from = 1 }
inputs = { transitions = ["bootstrap", "collect@sofar"], model = "represent", old_model = "represent@prev", old_agent = "control@prev" }

[stages.control]
kind = "train_sac"
loop = true
inputs = { transitions = ["bootstrap", "collect@sofar"], model = "represent", start = "distill" }

[stages.evaluate]
kind = "evaluate"
loop = true
inputs = { model = "represent", agent = "control" }
episodes = 10

[stages.map]
kind = "export_latent_map"
loop = true
inputs = { model = "represent" }
"#;
