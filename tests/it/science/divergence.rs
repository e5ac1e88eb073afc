//! Training that diverges fails by name within a step.

use std::{
    panic::{AssertUnwindSafe, catch_unwind},
    sync::LazyLock,
};

use crate::support::{
    run::{Bench, state},
    stages,
};
use carl_pipe::{
    artifact::{Files, must_be_finite},
    pipeline::{Overrides, Source, load},
    run::events::NodeState,
    stage,
};
use serde_json::{Value, json};

pub(super) static CHAIN: LazyLock<stages::Chain> = LazyLock::new(stages::Chain::run);

/// Inputs of a stage by port.
pub(super) type Owned<'a> = Vec<(&'static str, Vec<&'a Files>)>;

/// Runs a stage that may diverge: its error, or `None` where all numbers of its output are finite.
pub(super) fn error_of(kind: &str, given: Value, inputs: &Owned<'_>) -> Option<String> {
    let inputs: Vec<_> = inputs.iter().map(|(port, files)| (*port, &files[..])).collect();
    let stage = || stages::run_for(&stages::planar(), kind, given.clone(), &inputs, stages::stream(kind), 1);
    match catch_unwind(AssertUnwindSafe(stage)).unwrap_or_else(|_| panic!("{kind} panics with {given}")) {
        Ok(files) => {
            must_be_finite(&files, &[]).unwrap_or_else(|error| panic!("{kind} gave, with {given}: {error:#}"));
            None
        }
        Err(error) => Some(format!("{error:#}")),
    }
}

/// The number of the step in which a stage diverged.
fn step(error: &str) -> u64 {
    let rest = error.strip_prefix("diverged in step ").unwrap_or_else(|| panic!("{error}"));
    rest.split(':').next().and_then(|number| number.parse().ok()).unwrap_or_else(|| panic!("{error}"))
}

/// Every training stage, with one parameter to set, by its dotted path, and the others so that it takes few steps.
fn training() -> Vec<(&'static str, Value, Owned<'static>)> {
    let chain = &*CHAIN;
    let data = || ("transitions", vec![&chain.bootstrap]);
    let next = || vec![data(), ("warm_start", vec![&chain.model])];
    let epochs = json!({ "epochs": 4, "warm_up": { "epochs": 2, "anchor_epochs": 1 }, "ramp": { "epochs": 1 } });
    let carry = vec![
        data(),
        ("model", vec![&chain.next_model]),
        ("old_model", vec![&chain.model]),
        ("old_agent", vec![&chain.agent]),
    ];
    vec![
        ("train_lce", epochs, vec![data()]),
        (
            "train_lce",
            json!({ "epochs": 2, "objective": "pcc", "slopes": "amortized" }),
            vec![data(), ("warm_start", vec![&chain.amortized_model])],
        ),
        ("train_lce", json!({ "epochs": 3, "objective": "rce", "warm_up": { "epochs": 1 } }), vec![data()]),
        ("train_lce", json!({ "epochs": 3, "objective": "e2c", "warm_up": { "epochs": 1 } }), vec![data()]),
        ("train_lce", json!({ "epochs": 3, "objective": { "pc3": {} }, "warm_up": { "epochs": 1 } }), vec![data()]),
        ("train_lce", json!({ "epochs": 1, "slopes": { "exact": { "refit_steps": 20 } } }), next()),
        (
            "train_lce",
            json!({ "epochs": 1, "objective": { "value_guided": { "normalize": false } } }),
            [next(), vec![("value", vec![&chain.agent])]].concat(),
        ),
        ("train_sac", json!({ "steps": 8, "bootstrap": true }), vec![data(), ("model", vec![&chain.model])]),
        ("distill_policy", json!({ "steps": 8, "batch": 32 }), carry),
    ]
}

fn with(mut given: Value, path: &str, value: f64) -> Value {
    let mut at = &mut given;
    for part in path.split('.') {
        at = at.as_object_mut().expect("a table").entry(part).or_insert_with(|| json!({}));
    }
    *at = json!(value);
    given
}

#[test]
fn training_with_absurd_steps_or_losses_diverges_by_name_or_ends_finite() {
    let mut diverged = Vec::new();
    for (kind, given, inputs) in training() {
        let paths: &[&str] = match kind {
            "train_lce" => &["learning_rate", "warm_up.learning_rate", "warm_up.loss.scale", "curvature_sigma"],
            "train_sac" => &[
                "actor_learning_rate",
                "critic_learning_rate",
                "temperature.tuned.learning_rate",
                "initial_temperature",
            ],
            _ => &["learning_rate"],
        };
        for path in paths {
            for value in [1e3, 1e10, 1e30, 1e300] {
                if let Some(error) = error_of(kind, with(given.clone(), path, value), &inputs) {
                    assert!(step(&error) < 25, "{error}");
                    assert!(error.contains(&format!("`{path}` = 1e")) || value < 1e6, "{kind}: {error}");
                    diverged.push((kind, *path));
                }
            }
        }
    }
    for (kind, path) in [
        ("train_lce", "learning_rate"),
        ("train_lce", "warm_up.learning_rate"),
        ("train_lce", "warm_up.loss.scale"),
        ("train_sac", "actor_learning_rate"),
        ("train_sac", "critic_learning_rate"),
        ("distill_policy", "learning_rate"),
    ] {
        assert!(diverged.contains(&(kind, path)), "{path} never made {kind} diverge");
    }
}

#[test]
fn a_deviation_that_a_loss_divides_by_is_named_where_it_is_tiny() {
    let tiny = json!({ "epochs": 2, "warm_up": { "epochs": 2, "anchor_epochs": 0, "loss": { "sigma": 1e-30 } } });
    let error = error_of("train_lce", tiny, &vec![("transitions", vec![&CHAIN.bootstrap])]).expect("diverged");
    assert!(error.ends_with("; `warm_up.loss.sigma` = 1e-30 is the likely cause: try 0.3, its default"), "{error}");
}

#[test]
fn a_stage_that_diverged_has_no_result_and_nothing_after_it_runs() {
    let text = r#"schema = 1
name = "diverges"
[task]
env = "planar"
[stages.data]
kind = "generate_data"
samples = 32
[stages.represent]
kind = "train_lce"
inputs = { transitions = "data" }
epochs = 2
warm_up = { epochs = 1, anchor_epochs = 0 }
ramp.epochs = 0
restarts = 0
[stages.control]
kind = "train_sac"
inputs = { transitions = "data", model = "represent" }
steps = 250
critic_learning_rate = 1e6
[stages.evaluate]
kind = "evaluate"
inputs = { model = "represent", agent = "control" }
"#;
    let graph = load(&Source::new("p.toml", text), &Overrides::default(), stage::registry()).expect("a pipeline");
    let bench = Bench::new();
    let (report, ear) = bench.run(&graph);
    assert_eq!(ear.ran(), ["data", "represent"]);
    assert_eq!(["control", "evaluate"].map(|node| state(&report, node)), [NodeState::Failed, NodeState::Pending]);
    let failed = format!("{:?}", report.nodes().find_map(|node| node.failure));
    assert!(failed.contains("diverged in step ") && failed.contains("`critic_learning_rate` = 1e6"), "{failed}");
    let again = bench.run(&graph).1;
    assert_eq!(again.ran(), [""; 0], "the same is not computed twice, and nothing was published");
}
