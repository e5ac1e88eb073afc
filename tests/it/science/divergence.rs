//! Training that diverges fails by name within a step.

use std::{
    panic::{AssertUnwindSafe, catch_unwind},
    sync::LazyLock,
};

use crate::support::stages;
use carl_pipe::artifact::{Files, must_be_finite};
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
        ("train_lce", json!({ "epochs": 1, "slopes": { "exact": { "refit_steps": 20 } } }), next()),
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
