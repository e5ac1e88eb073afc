//! Runs single stages on tiny inputs, as the engine would, without an engine.
#![allow(dead_code, reason = "every test file uses a part")]

use std::collections::BTreeMap;

use carl_pipe::{
    artifact::Files,
    digest::Digest,
    env::Task,
    num::{Threads, rng::Stream},
    record::Recorder,
    stage::{self, Host, InputFiles, Kind, Preset, PresetOf, StageCx},
};
use serde_json::{Map, Value, json};

/// A host that hears nothing and stops nobody.
pub struct Quiet;

impl Host for Quiet {
    fn progress(&self, _: u64, _: u64, _: &str) {}
    fn metric(&self, _: &str, _: f64) {}
    fn say(&self, _: &str) {}
    fn stop_asked(&self) -> bool {
        false
    }
}

/// The planar task without noise.
pub fn planar() -> Task {
    serde_json::from_value(json!({ "env": "planar" })).expect("a task")
}

/// The node's randomness: seed 0 in the first round.
pub fn stream(kind: &str) -> Stream {
    Stream { seed: 0, kind: kind.to_owned(), round: 0, stream: None }
}

/// The recipe's parameters with some of them changed.
fn params(kind: &Kind, task: &Task, given: &Value) -> Value {
    let given = given.as_object().cloned().unwrap_or_default();
    let mut params = (kind.preset)(&PresetOf { preset: Preset::Recipe, task, given: &given });
    if kind.name == "train_lce" {
        // Detectors doubt every map of a few steps.
        params["restarts"] = json!(0);
    }
    lay_over(params.as_object_mut().expect("a table"), &given);
    assert!((kind.check)(&params, task).expect("known parameters").is_empty());
    params
}

fn lay_over(below: &mut Map<String, Value>, above: &Map<String, Value>) {
    for (name, value) in above {
        match (below.get_mut(name).and_then(Value::as_object_mut), value.as_object()) {
            (Some(below), Some(above)) => lay_over(below, above),
            _ => drop(below.insert(name.clone(), value.clone())),
        }
    }
}

/// Inputs of a stage by port.
pub type Inputs<'a> = [(&'static str, &'a [&'a Files])];

/// Runs one stage on the planar task with a stream and a number of threads of its own.
pub fn run_as(kind: &str, given: Value, inputs: &Inputs<'_>, stream: Stream, threads: usize) -> Files {
    run_for(&planar(), kind, given, inputs, stream, threads).expect("a stage that works")
}

/// Runs one stage of a task, which may fail.
pub fn run_for(
    task: &Task,
    kind: &str,
    given: Value,
    inputs: &Inputs<'_>,
    stream: Stream,
    threads: usize,
) -> anyhow::Result<Files> {
    run_heard(task, kind, given, inputs, stream, threads, &Quiet)
}

/// Runs one stage of a task before a host.
pub fn run_heard(
    task: &Task,
    kind: &str,
    given: Value,
    inputs: &Inputs<'_>,
    stream: Stream,
    threads: usize,
    host: &dyn Host,
) -> anyhow::Result<Files> {
    let kind = stage::kind(kind).expect("a kind");
    let params = params(kind, task, &given);
    let mut files = InputFiles { by_port: BTreeMap::new() };
    for (port, values) in inputs {
        assert!(kind.ports.iter().any(|known| known.name == *port), "{} has no port {port}", kind.name);
        files.by_port.insert(port, values.to_vec());
    }
    let mut record = Recorder::off();
    let mut cx = StageCx::new(&mut record, task, stream, 0, Threads::new(threads), host);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    pool.install(|| (kind.run)(&params, &files, &mut cx))
}

/// Runs one stage.
pub fn run(kind: &str, given: Value, inputs: &Inputs<'_>) -> Files {
    run_as(kind, given, inputs, stream(kind), 2)
}

/// What every kind makes, fed by the kinds before it.
pub struct Chain {
    pub bootstrap: Files,
    pub model: Files,
    pub agent: Files,
    pub collected: Files,
    /// Goes on from `model` with every option that `model` leaves out: PCC's prior and L_reg.
    pub next_model: Files,
    /// Goes on from `model` with the values of `agent`.
    pub guided_model: Files,
    /// With heads for F's slopes.
    pub amortized_model: Files,
    pub distilled: Files,
    /// As in the paper's preset, with a bootstrap and the quadratic reward.
    pub next_agent: Files,
    pub evaluation: Files,
    pub ilqr: Files,
    /// iLQR on `next_model`.
    pub planned: Files,
    pub map: Files,
    /// Of `evaluation`, twice.
    pub summary: Files,
    /// Two episodes with costs.
    pub trajectories: Files,
    pub solar_model: Files,
    pub solar_controller: Files,
    /// SOLAR's controller towards one goal.
    pub solar_evaluation: Files,
}

impl Chain {
    pub fn run() -> Self {
        let bootstrap = run("generate_data", json!({ "samples": 64 }), &[]);
        let few = json!({ "epochs": 3, "warm_up": { "epochs": 1 }, "ramp": { "epochs": 1 }, "map_every": 100 });
        let model = run("train_lce", few, &[("transitions", &[&bootstrap])]);
        let agent = run("train_sac", json!({ "steps": 3 }), &[("transitions", &[&bootstrap]), ("model", &[&model])]);
        let collected = run("collect", json!({ "samples": 8 }), &[("model", &[&model]), ("agent", &[&agent])]);
        let all: &[&Files] = &[&bootstrap, &collected];
        let pcc = json!({ "objective": "pcc", "epochs": 1, "lambda": { "regularizer": 0.1 } });
        let next_model =
            run("train_lce", pcc, &[("transitions", all), ("warm_start", &[&model]), ("policy", &[&agent])]);
        let guided = json!({ "objective": { "value_guided": { "temperature": 1.0 } }, "epochs": 1 });
        let guided_model =
            run("train_lce", guided, &[("transitions", all), ("warm_start", &[&model]), ("value", &[&agent])]);
        let amortized = json!({ "objective": "pcc", "slopes": "amortized", "epochs": 2, "warm_up": { "epochs": 1 },
                                "ramp": { "epochs": 1 } });
        let amortized_model = run("train_lce", amortized, &[("transitions", &[&bootstrap])]);
        let carry: &Inputs<'_> =
            &[("transitions", all), ("model", &[&next_model]), ("old_model", &[&model]), ("old_agent", &[&agent])];
        let distilled = run("distill_policy", json!({ "steps": 3, "batch": 32 }), carry);
        let other = json!({ "steps": 2, "bootstrap": true, "reward": "quadratic", "temperature": "decayed",
                            "critic_actions": "data", "policy_ema_rate": 1.0, "relabel": 0.0, "rollout": 2 });
        let next_agent =
            run("train_sac", other, &[("transitions", all), ("model", &[&next_model]), ("start", &[&distilled])]);
        let evaluation =
            run("evaluate", json!({ "episodes": 2 }), &[("model", &[&next_model]), ("agent", &[&next_agent])]);
        let ilqr = run("control_ilqr", json!({ "plan_length": 3, "uniform_plans": 1, "bang_bang_plans": 1 }), &[]);
        let planned = json!({ "controller": "ilqr", "episodes": 2 });
        let planned = run("evaluate", planned, &[("model", &[&next_model]), ("ilqr", &[&ilqr])]);
        let map = run("export_latent_map", json!({}), &[("model", &[&next_model])]);
        let summary = run("summarize", json!({}), &[("evaluations", &[&evaluation, &evaluation])]);
        let costs = json!({ "samples": 80, "costs": { "true_state": {} } });
        let trajectories = run("generate_trajectories", costs, &[]);
        let solar_model = run("train_solar", json!({ "epochs": 2 }), &[("trajectories", &[&trajectories])]);
        let few = json!({ "iterations": 2, "rollouts": 3, "sweeps": 3 });
        let solar_controller = run("control_solar", few, &[("model", &[&solar_model])]);
        let only =
            json!({ "controller": "solar", "episodes": 2, "goals": { "only": { "goal": 1 } }, "start": "fixed" });
        let solar_evaluation = run("evaluate", only, &[("solar", &[&solar_controller])]);
        Self {
            bootstrap,
            model,
            agent,
            collected,
            next_model,
            guided_model,
            amortized_model,
            distilled,
            next_agent,
            evaluation,
            ilqr,
            planned,
            map,
            summary,
            trajectories,
            solar_model,
            solar_controller,
            solar_evaluation,
        }
    }

    /// Every artifact in the order of making: a name, the kind that made it, the names of its inputs, its files.
    pub fn all(&self) -> [(&'static str, &'static str, &'static [&'static str], &Files); 18] {
        [
            ("bootstrap", "generate_data", &[], &self.bootstrap),
            ("model", "train_lce", &["bootstrap"], &self.model),
            ("agent", "train_sac", &["bootstrap", "model"], &self.agent),
            ("collected", "collect", &["model", "agent"], &self.collected),
            ("next_model", "train_lce", &["bootstrap", "collected", "model", "agent"], &self.next_model),
            ("guided_model", "train_lce", &["bootstrap", "collected", "model", "agent"], &self.guided_model),
            ("amortized_model", "train_lce", &["bootstrap"], &self.amortized_model),
            (
                "distilled",
                "distill_policy",
                &["bootstrap", "collected", "model", "next_model", "agent"],
                &self.distilled,
            ),
            ("next_agent", "train_sac", &["bootstrap", "collected", "next_model", "distilled"], &self.next_agent),
            ("evaluation", "evaluate", &["next_model", "next_agent"], &self.evaluation),
            ("ilqr", "control_ilqr", &[], &self.ilqr),
            ("planned", "evaluate", &["next_model", "ilqr"], &self.planned),
            ("map", "export_latent_map", &["next_model"], &self.map),
            ("summary", "summarize", &["evaluation"], &self.summary),
            ("trajectories", "generate_trajectories", &[], &self.trajectories),
            ("solar_model", "train_solar", &["trajectories"], &self.solar_model),
            ("solar_controller", "control_solar", &["solar_model"], &self.solar_controller),
            ("solar_evaluation", "evaluate", &["solar_controller"], &self.solar_evaluation),
        ]
    }
}

/// The content digest of an artifact, over its file names and their bytes.
pub fn digest(files: &Files) -> Digest {
    Digest::of_files(files.iter().map(|(name, content)| (name, Digest::of_bytes(&content.bytes().expect("bytes")))))
}
