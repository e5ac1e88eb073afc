//! How a pipeline and the kinds are shown: compared with `tests/it/pipeline/render/`.
//!
//! `UPDATE_SNAPSHOTS=1 cargo test --test it pipeline::render` writes those files anew; read the difference before you commit.

use std::{fs, path::Path};

use crate::support::pipeline::{ONLINE, graph, graph_with, kinds, node};
use carl_pipe::{
    env::Task,
    pipeline::{dag_mermaid, dag_text, dag_text_expanded, stages_json, stages_text},
};

fn expect(name: &str, text: &str) {
    let path = Path::new("tests/it/pipeline/render").join(name);
    if std::env::var_os("UPDATE_SNAPSHOTS").is_some() {
        fs::create_dir_all("tests/it/pipeline/render").unwrap();
        fs::write(&path, text).unwrap();
    }
    let expected = fs::read_to_string(&path).unwrap_or_default();
    assert!(text == expected, "{} differs; now it is:\n{text}", path.display());
    assert!(text.lines().all(|line| line.chars().count() <= 100), "{name} is wider than 100 columns");
}

fn task() -> Task {
    node(&graph(ONLINE), "bootstrap").task.clone()
}

const SUMMARY: &str = "\n[stages.summary]\nkind = \"summarize\"\ninputs = { evaluations = \"evaluate@last[*]\" }\n";

#[test]
fn a_pipeline_by_stage() {
    expect("dag.txt", &dag_text(&graph(ONLINE)));
    let swept = graph_with(&format!("{ONLINE}{SUMMARY}"), &[], &["seed=0..25"]);
    expect("dag_swept.txt", &dag_text(&swept));
}

#[test]
fn a_pipeline_node_by_node() {
    expect("dag_expanded.txt", &dag_text_expanded(&graph_with(ONLINE, &["rounds=3"], &["represent.epochs=1,2"])));
}

#[test]
fn a_pipeline_as_a_flowchart() {
    expect("dag.mmd", &dag_mermaid(&graph(&format!("{ONLINE}{SUMMARY}"))));
}

#[test]
fn the_kinds_with_inputs_and_parameters() {
    expect("stages.txt", &stages_text(kinds(), &task()));
    let json = stages_json(kinds(), &task());
    let lambda = &json[1]["parameters"][3];
    assert_eq!((lambda["path"].as_str(), &lambda["recipe"]), (Some("lambda.consistency"), &serde_json::json!(7.0)));
}
