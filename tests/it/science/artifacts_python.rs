//! Artifacts open in Python without us, and their tensors say enough to compute what we compute.
//!
//! Needs `pip install -r tests/python/requirements.txt`; without it the test says so and passes.

use crate::support::{python::python_has, stages};
use std::{path::Path, process::Command};

use carl_pipe::{
    artifact::{Artifact as _, Files, TrainedModel, Transitions},
    control::Agent,
};
use serde_json::Value;

fn write(folder: &Path, name: &str, files: &Files) {
    let folder = folder.join(name);
    std::fs::create_dir(&folder).expect("a folder");
    for (name, content) in files.iter() {
        std::fs::write(folder.join(name), content.bytes().expect("bytes")).expect("a file");
    }
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().expect("a list").iter().map(|x| x.as_f64().expect("a number")).collect()
}

#[track_caller]
fn near(ours: &[f32], python: &[f64]) {
    assert_eq!(ours.len(), python.len());
    for (ours, python) in ours.iter().zip(python) {
        assert!((f64::from(*ours) - python).abs() < 1e-5, "{ours} here, {python} in Python");
    }
}

#[test]
fn python_recomputes_codes_and_actions() {
    if !python_has("numpy, safetensors") {
        return;
    }
    let chain = stages::Chain::run();
    let folder = tempfile::tempdir().expect("a folder");
    for (name, files) in [("transitions", &chain.bootstrap), ("model", &chain.model), ("agent", &chain.agent)] {
        write(folder.path(), name, files);
    }
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/python/read_artifacts.py");
    let output = Command::new("python3").arg(script).arg(folder.path()).output().expect("python3");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let python: Value = serde_json::from_slice(&output.stdout).expect("JSON");

    let transitions = Transitions::load(&chain.bootstrap).expect("transitions");
    let model = TrainedModel::load(&chain.model).expect("a model").model;
    let agent = Agent::load(&chain.agent).expect("an agent");
    let pixels = transitions.pixels();
    let first = model.pictures(&transitions.observations[..4 * pixels]);
    near(&model.encode(&first), &numbers(&python["codes"]));
    let goal = model.encode_means(&model.pictures(&transitions.goals[..pixels]));
    let goals: Vec<f32> = goal.iter().copied().cycle().take(4 * goal.len()).collect();
    near(&agent.act(&model.encode_means(&first), &goals, None), &numbers(&python["actions"]));
}
