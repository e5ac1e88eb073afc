//! Suites from the command line, and the verbs that read results: `table`, `plot` by samples, `compare`.

use std::fs;

use crate::support::cli::{Ended, Toy, assert_snapshot};
use serde_json::{Value, json};

const SUITE: &str = r#"schema = 1
name = "two"
description = "A pipeline, and the same with one more"
seeds = "0..3"

[suite.plain]
pipeline = "toy.toml"
labels = { algorithm = "plain", paper = "12.5 ± 1", additions = "a longer view" }

[suite.more]
pipeline = "toy.toml"
set = { evaluate.plus = 1 }
labels = { algorithm = "one more" }
"#;

/// A folder with a suite.
fn toys() -> Toy {
    let toy = Toy::new();
    fs::write(toy.path("two.toml"), SUITE).unwrap();
    toy
}

fn rows(ended: &Ended) -> Vec<Value> {
    ended.json()["cells"].as_array().unwrap_or_else(|| panic!("{ended:?}")).clone()
}

#[test]
fn equal_nodes_of_members_run_once_and_both_have_their_result() {
    let toy = toys();
    let report = toy.run("run two.toml --json").json();
    // Three seeds: data, three rounds of learning and of evaluation; the evaluations alone differ.
    assert_eq!((&report["executed"], &report["cached"]), (&json!(3 * (1 + 3 + 3 + 3)), &json!(3 * 4)));
    let nodes = &report["nodes"];
    for node in ["data[seed=1]", "learn@2[seed=0]"] {
        let (one, other) = (&nodes[format!("plain/{node}")], &nodes[format!("more/{node}")]);
        assert_eq!(one["digest"], other["digest"]);
        assert!(one["digest"].is_string());
        let mut states = [one["state"].as_str(), other["state"].as_str()];
        states.sort_unstable();
        assert_eq!(states, [Some("cached"), Some("ran")], "{node}");
    }
    assert_ne!(nodes["plain/evaluate@2[seed=0]"]["digest"], nodes["more/evaluate@2[seed=0]"]["digest"]);
    // A mean over both would mean nothing.
    assert_eq!(report["percent_goal"], Value::Null);
    assert_eq!(toy.run("run two.toml --json").json()["executed"], json!(0));
    assert_eq!(toy.run("status two.toml").code, Some(0));
    assert_eq!(toy.run("replay latest --json").json()["equal"], json!(42));
}

#[test]
fn what_ran_alone_is_cached_in_a_suite() {
    let toy = toys();
    toy.run("run toy.toml --sweep seed=0..3");
    let report = toy.run("run two.toml plain --json").json();
    assert_eq!((&report["executed"], &report["cached"]), (&json!(0), &json!(21)));
    let why = toy.run("why two.toml plain/learn@1[seed=1] -S learn.plus=2");
    assert!(why.out.starts_with("plain/learn@1[seed=1]: plus 0 -> 2"), "{why:?}");
    assert_eq!(toy.run("run two.toml more/evaluate -n").code, Some(0));
}

#[test]
fn files_of_two_members_never_share_a_name() {
    let toy = Toy::new();
    let suite = "schema = 1\nname = \"s\"\n[suite.a]\npipeline = \"one.toml\"\n[suite.a_b]\npipeline = \"two.toml\"\n";
    fs::write(toy.path("s.toml"), suite).unwrap();
    let pipeline = |name: &str, stage: &str, plus: u8| {
        let text = format!(
            "schema = 1\nname = \"{name}\"\n[task]\nenv = \"planar\"\n[stages.{stage}]\nkind = \"toy_number\"\nplus = {plus}\n"
        );
        fs::write(toy.path(&format!("{name}.toml")), text).unwrap();
    };
    pipeline("one", "b_c", 1);
    pipeline("two", "c", 2);
    assert_eq!(toy.run("run s.toml").code, Some(0));
    let read = |name: &str| fs::read_to_string(toy.path("artifacts/runs/latest").join(name)).unwrap();
    assert_ne!(read("a.b_c.value.json"), read("a_b.c.value.json"));
}

#[test]
fn a_suite_ends_with_its_table() {
    let toy = toys();
    let ended = toy.run("run two.toml -q");
    assert_eq!(ended.code, Some(0), "{ended:?}");
    let lines: Vec<&str> = ended.out.lines().collect();
    assert_eq!(lines[2].split_whitespace().collect::<Vec<_>>(), ["task", "plain", "one", "more"], "{ended:?}");
    assert!(lines[3].starts_with("planar"), "{ended:?}");
    assert!(lines[4].contains("the paper's") && lines[4].contains("12.5 ± 1"), "{ended:?}");
    // One pipeline over its seeds needs no table.
    let swept = toy.run("run toy.toml --sweep seed=0..3 -q");
    assert_eq!(swept.out.lines().count(), 1);
    assert!(swept.out.contains("; percent_goal ") && swept.out.contains(" (3)"), "{swept:?}");
}

#[test]
fn a_table_has_every_statistic_in_every_format() {
    let toy = toys();
    toy.run("run two.toml");
    assert_snapshot("table", &toy.run("table").out);
    assert_snapshot("table_long", &toy.run("table --long").out);
    assert_snapshot("table_markdown", &toy.run("table --format markdown").out);
    assert_snapshot("table_csv", &toy.run("table --format csv").out);
    let cells = rows(&toy.run("table --format json"));
    assert_eq!((cells.len(), &cells[0]["n"], &cells[0]["paper"]), (2, &json!(3), &json!("12.5 ± 1")));
    let models = cells[0]["models"].as_array().unwrap();
    let mean = models.iter().map(|model| model["value"].as_f64().unwrap()).sum::<f64>() / 3.0;
    assert!((cells[0]["mean"].as_f64().unwrap() - mean).abs() < 1e-9);
}

#[test]
fn labels_tell_columns_apart_but_not_what_a_method_has_beyond_the_paper() {
    let toy = toys();
    let labels = |start: &str, additions: &str| {
        format!("labels = {{ algorithm = \"carl\", start_data = \"{start}\", additions = \"{additions}\" }}\n")
    };
    let member = |name: &str, plus: usize, labels: String| {
        format!("[suite.{name}]\npipeline = \"toy.toml\"\nset = {{ evaluate.plus = {plus} }}\n{labels}")
    };
    let [one, two] =
        [("uniform", "a longer view"), ("biased", "other networks")].map(|(start, more)| labels(start, more));
    let suite = ["schema = 1\nname = \"starts\"\n".to_owned(), member("one", 1, one), member("two", 2, two)].concat();
    fs::write(toy.path("starts.toml"), suite).unwrap();
    let ended = toy.run("run starts.toml -q");
    assert!(ended.out.contains("carl, uniform") && ended.out.contains("carl, biased"), "{ended:?}");
    assert!(!ended.out.contains("a longer view"), "{ended:?}");
}

#[test]
fn several_runs_are_pooled_and_no_seed_counts_twice() {
    let toy = toys();
    toy.run("run toy.toml --sweep seed=0,1");
    toy.run("run toy.toml --sweep seed=1,2");
    toy.run("run toy.toml --sweep seed=0..3 -S learn.plus=1");
    let log = toy.run("log --json");
    let runs: Vec<String> = log
        .out
        .lines()
        .map(|line| serde_json::from_str::<Value>(line).unwrap()["run"].as_str().unwrap().to_owned())
        .collect();
    let cells = rows(&toy.run(&format!("table {} {} --format json", runs[1], runs[2])));
    assert_eq!((cells.len(), &cells[0]["seeds"]), (1, &json!("0 to 2")));
    // Another recipe is not pooled, whatever its name.
    let cells = rows(&toy.run(&format!("table {} {} {} --format json", runs[0], runs[1], runs[2])));
    assert_eq!(cells.len(), 2);
    let cells = rows(&toy.run("table --rows round --format json"));
    assert_eq!(cells.len(), 3);
}

#[test]
fn a_table_says_what_there_is() {
    let toy = toys();
    toy.run("run two.toml");
    let unknown = toy.run("table --rows algoritm");
    assert_eq!(unknown.code, Some(2));
    assert!(unknown.err.contains("nothing in these runs is called `algoritm`"), "{unknown:?}");
    assert!(unknown.err.contains("did you mean `algorithm`?"), "{unknown:?}");
    let unknown = toy.run("table --metric percent");
    assert!(unknown.err.contains("no result has the metric `percent`"), "{unknown:?}");
    toy.run("run toy.toml data");
    assert!(toy.run("table").err.contains("no evaluation of the last round is finished"));
}

#[test]
fn a_comparison_names_parameters_metrics_and_outputs() {
    let toy = toys();
    toy.run("run toy.toml --sweep seed=0..3");
    let first = fs::read_link(toy.path("artifacts/runs/latest")).unwrap().display().to_string();
    toy.run("run toy.toml --sweep seed=1..4 -S evaluate.plus=2");
    let told = toy.run(&format!("compare {first} latest"));
    assert_eq!(told.code, Some(0), "{told:?}");
    assert!(told.out.contains("toy/evaluate@0 to 2  plus 0 -> 2"), "{told:?}");
    assert!(told.out.contains("2 pairs of models"), "{told:?}");
    assert!(told.out.contains("outputs: 8 equal, 6 differ, first evaluate@0[seed=1]"), "{told:?}");
    let json = toy.run(&format!("compare {first} --json")).json();
    assert_eq!(json["figures"][0]["difference"]["mean"], json!(2.0));
    assert_eq!((&json["figures"][0]["difference"]["pairs"], &json["outputs"]["equal"]), (&json!(2), &json!(8)));
    // A member of a suite is compared with the pipeline that ran alone.
    toy.run("run two.toml");
    let json = toy.run(&format!("compare {first} --json")).json();
    assert_eq!(json["outputs"]["equal"], json!(33));
}

#[test]
fn several_pipelines_are_drawn_in_one_picture() {
    let toy = toys();
    toy.run("run two.toml");
    let plotted = toy.run("plot -o pictures --band ci");
    assert_eq!((plotted.code, plotted.out.as_str()), (Some(0), "pictures/learning_curves_planar.svg\n"), "{plotted:?}");
    let picture = fs::read_to_string(toy.path("pictures/learning_curves_planar.svg")).unwrap();
    for words in ["samples", "bands: 95 % bootstrap interval", "the paper's mean 12.5"] {
        assert!(picture.contains(&format!(">{words}</text>")), "{words}");
    }
    let one = toy.run("plot --member more -o one");
    assert!(one.out.starts_with("one/percent_goal.svg"), "{one:?}");
    assert_eq!(toy.run("plot --member nobody").code, Some(2));
}
