//! A stage that was stopped and resumed from its saved state gives the bytes of one that ran through.

use crate::support::stages::{self, Inputs, Quiet};
use std::{
    collections::BTreeMap,
    sync::{
        Mutex,
        atomic::{AtomicU64, Ordering},
    },
};

use carl_pipe::{
    artifact::Files,
    num::Threads,
    record::Recorder,
    stage::{Host, Interrupted, StageCx, StageState},
};
use serde_json::{Value, json};

/// A host that starts from a state, asks for the state at one tick and stops there.
#[derive(Default)]
struct StopAt {
    tick: Option<u64>,
    ticks: AtomicU64,
    resumed: Option<Files>,
    saved: Mutex<Option<Files>>,
    metrics: Mutex<BTreeMap<String, f64>>,
    said: Mutex<Vec<String>>,
}

impl Host for StopAt {
    fn progress(&self, _: u64, _: u64, _: &str) {}
    fn metric(&self, name: &str, value: f64) {
        self.metrics.lock().unwrap().insert(name.to_owned(), value);
    }
    fn say(&self, text: &str) {
        self.said.lock().unwrap().push(text.to_owned());
    }
    fn stop_asked(&self) -> bool {
        self.saved.lock().unwrap().is_some()
    }
    fn saved_state(&self) -> Option<Files> {
        self.resumed.clone()
    }
    fn offer_state(&self, save: &dyn Fn() -> anyhow::Result<Files>) {
        if Some(self.ticks.fetch_add(1, Ordering::Relaxed) + 1) == self.tick {
            *self.saved.lock().unwrap() = Some(save().expect("a state"));
        }
    }
}

/// Stops a stage at every tick in turn, resumes it in a new context, and compares output and metrics.
fn resumes_at_every_tick(kind: &str, given: &Value, inputs: &Inputs<'_>) -> u64 {
    let run = |host: &StopAt| {
        stages::run_heard(&stages::planar(), kind, given.clone(), inputs, stages::stream(kind), 2, host)
    };
    let whole = StopAt::default();
    let output = run(&whole).expect("an artifact");
    let ticks = whole.ticks.load(Ordering::Relaxed);
    for tick in 1..=ticks {
        let stopped = StopAt { tick: Some(tick), ..StopAt::default() };
        let error = run(&stopped).expect_err("stopped");
        assert!(error.is::<Interrupted>(), "{error:#}");
        let resumed = StopAt { resumed: stopped.saved.into_inner().unwrap(), ..StopAt::default() };
        let again = run(&resumed).expect("an artifact");
        assert_eq!(stages::digest(&again), stages::digest(&output), "{kind} stopped at tick {tick}");
        assert_eq!(resumed.ticks.into_inner(), ticks - tick, "{kind} repeats no step");
        assert_eq!(*resumed.metrics.lock().unwrap(), *whole.metrics.lock().unwrap());
    }
    ticks
}

fn data() -> Files {
    stages::run("generate_data", json!({ "samples": 150 }), &[])
}

#[test]
fn the_representation_resumes_in_every_phase() {
    let data = data();
    let given = json!({ "epochs": 4, "warm_up": { "epochs": 2, "anchor_epochs": 1 }, "ramp": { "epochs": 1 }, "slopes": { "exact": { "refit_steps": 5 } } });
    assert_eq!(resumes_at_every_tick("train_lce", &given, &[("transitions", &[&data])]), 4);
}

#[test]
fn the_representation_resumes_while_it_retrains() {
    let data = data();
    let given =
        json!({ "epochs": 2, "warm_up": { "epochs": 1, "anchor_epochs": 0 }, "ramp": { "epochs": 1 }, "restarts": 2 });
    let ticks = resumes_at_every_tick("train_lce", &given, &[("transitions", &[&data])]);
    assert_eq!(ticks, 3 * 2, "three attempts");
}

#[test]
fn agent_and_distillation_resume() {
    let data = data();
    let few = json!({ "epochs": 2, "warm_up": { "epochs": 1 }, "ramp": { "epochs": 1 } });
    let model = stages::run("train_lce", few, &[("transitions", &[&data])]);
    let inputs: &Inputs<'_> = &[("transitions", &[&data]), ("model", &[&model])];
    // The buffer overflows before the first tick but one.
    let given = json!({ "steps": 30, "buffer": 1000, "learning_rate_end_factor": 0.5 });
    assert_eq!(resumes_at_every_tick("train_sac", &given, inputs), 3);
    let agent = stages::run("train_sac", given, inputs);
    let inputs: &Inputs<'_> =
        &[("transitions", &[&data]), ("model", &[&model]), ("old_model", &[&model]), ("old_agent", &[&agent])];
    for fresh in [false, true] {
        let given = json!({ "steps": 15, "batch": 32, "fresh": fresh });
        assert_eq!(resumes_at_every_tick("distill_policy", &given, inputs), 3);
    }
}

#[test]
fn solar_resumes_between_passes_and_between_iterations() {
    let data = stages::run("generate_trajectories", json!({ "samples": 120 }), &[]);
    let inputs: &Inputs<'_> = &[("trajectories", &[&data])];
    let given = json!({ "epochs": 3 });
    assert_eq!(resumes_at_every_tick("train_solar", &given, inputs), 3);
    let model = stages::run("train_solar", given, inputs);
    let given = json!({ "iterations": 3, "rollouts": 3, "sweeps": 3 });
    assert_eq!(resumes_at_every_tick("control_solar", &given, &[("model", &[&model])]), 3);
}

#[test]
fn an_unreadable_state_is_reported_and_the_stage_starts_afresh() {
    let data = data();
    let given = json!({ "epochs": 1, "warm_up": { "epochs": 1 } });
    let inputs: &Inputs<'_> = &[("transitions", &[&data])];
    let foreign = Files::from([("training.json".to_owned(), b"{}".to_vec())]);
    let host = StopAt { resumed: Some(foreign), ..StopAt::default() };
    let stream = stages::stream("train_lce");
    let output = stages::run_heard(&stages::planar(), "train_lce", given.clone(), inputs, stream, 2, &host);
    assert_eq!(output.expect("a model"), stages::run("train_lce", given, inputs));
    assert!(host.said.lock().unwrap().iter().any(|text| text.contains("cannot be read")));
}

/// A state that must not be written.
struct Unwritten;

impl StageState for Unwritten {
    fn save(&self) -> anyhow::Result<Files> {
        panic!("written although nobody asked")
    }
    fn load(_: &Files) -> anyhow::Result<Self> {
        Ok(Self)
    }
}

#[test]
fn a_state_is_written_only_when_the_host_asks() {
    let (mut record, task) = (Recorder::off(), stages::planar());
    let mut cx = StageCx::new(&mut record, &task, stages::stream("train_sac"), 0, Threads::new(1), &Quiet);
    let state = cx.resume_or(|| Ok(Unwritten)).expect("a fresh state");
    cx.tick(1, 2, "", &state).expect("nobody stops it");
}
