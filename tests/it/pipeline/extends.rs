//! A pipeline file that extends another one: what it inherits, what it changes, and where its mistakes are shown.

use std::fs;

use crate::support::pipeline::{ONLINE, kinds, node, overrides, taken};
use carl_pipe::{
    diag::Diagnostics,
    pipeline::{Graph, Source, load_with},
    run::{key, node::Work},
    stage::NothingOutside,
};
use serde_json::json;

const SHORT: &str = r#"schema = 1
extends = "online.toml"
name = "short"

[labels]
size = "small"

[loop]
rounds = 3

[stages.represent]
epochs = 2
first.epochs = 4
inputs.agent = "control@prev"
"#;

/// Loads `text` as `folder/short.toml`, beside the base and other files.
fn try_load(text: &str, set: &[&str], sweep: &[&str]) -> Result<Graph, Diagnostics> {
    let suite = "schema = 1\nname = \"s\"\n[suite.one]\npipeline = \"sub/short.toml\"\n";
    let labelled = ONLINE.replace("[task]", "[labels]\nalgorithm = \"online\"\nsize = \"large\"\n\n[task]");
    let read = |path: &str| match path {
        "online.toml" | "sub/online.toml" | "/home/online.toml" => {
            Ok(Source::new(format!("folder/{path}"), &*labelled))
        }
        "short.toml" | "./short.toml" => Ok(Source::new(format!("folder/{path}"), text)),
        "sub/short.toml" => Ok(Source::new(format!("folder/{path}"), SHORT)),
        "wrong.toml" => Ok(Source::new(format!("folder/{path}"), ONLINE.replace("epochs = 15", "epoch = 15"))),
        "none.toml" => Ok(Source::new(format!("folder/{path}"), "name = ")),
        "no_schema.toml" => Ok(Source::new(format!("folder/{path}"), ONLINE.replace("schema = 1", ""))),
        "suite.toml" => Ok(Source::new(format!("folder/{path}"), suite)),
        _ => Err("No such file or directory".to_owned()),
    };
    load_with(&Source::new("folder/short.toml", text), &overrides(set, sweep), kinds(), &read, &NothingOutside)
}

fn graph(text: &str, set: &[&str], sweep: &[&str]) -> Graph {
    try_load(text, set, sweep).unwrap_or_else(|mistakes| panic!("{}", mistakes.render(false)))
}

fn changed(from: &str, to: &str) -> Graph {
    assert!(SHORT.contains(from), "{from}");
    graph(&SHORT.replacen(from, to, 1), &[], &[])
}

#[test]
fn the_file_is_laid_over_its_base_key_by_key() {
    let graph = graph(SHORT, &[], &[]);
    assert_eq!((&*graph.name, &*graph.description), ("short", "Online CARL on planar navigation (paper, Table 1)"));
    assert_eq!(node(&graph, "represent@0").params["epochs"], 4);
    assert_eq!(node(&graph, "represent@1").params["epochs"], 2);
    assert_eq!(node(&graph, "represent@1").params["objective"], "carl");
    assert_eq!(taken(&graph, "represent@1", "agent"), ["control@0"]);
    assert_eq!(taken(&graph, "represent@1", "warm_start"), ["represent@0"]);
    assert!(graph.nodes.iter().all(|node| node.round.is_none_or(|round| round < 3)));
    let labels: Vec<_> = graph.members[0].labels.iter().map(|(name, text)| (&**name, &**text)).collect();
    assert_eq!(labels, [("algorithm", "online"), ("size", "small")]);
}

#[test]
fn keys_do_not_tell_whether_a_file_extends_another_one() {
    let whole = ONLINE
        .replace("rounds = 17", "rounds = 3")
        .replace("epochs = 15", "epochs = 2")
        .replace("epochs = 400", "epochs = 4")
        .replace("warm_start = \"represent@prev\"", "warm_start = \"represent@prev\", agent = \"control@prev\"");
    let keys = |graph: &Graph| graph.nodes.iter().map(|node| key::without_inputs(&Work::of(node))).collect::<Vec<_>>();
    assert_eq!(keys(&graph(SHORT, &[], &[])), keys(&graph(&whole, &[], &[])));
}

#[test]
fn a_stage_with_a_kind_and_a_task_with_an_env_are_whole() {
    let (above, _) = SHORT.split_once("[stages.represent]").expect("the stage");
    let whole = "[stages.represent]\nkind = \"train_lce\"\nloop = true\ninputs.transitions = \"bootstrap\"\n";
    let stage = graph(&format!("{above}{whole}"), &[], &[]);
    let params = &node(&stage, "represent@0").params;
    assert_eq!((&params["epochs"], &params["objective"]), (&json!(20), &json!("pcc")), "the base says 15 and carl");
    assert_eq!(taken(&stage, "represent@1", "warm_start"), [""; 0]);
    let task = changed("[loop]", "[task]\nenv = \"three_pole\"\nlinks = 2\n\n[loop]");
    assert_eq!(serde_json::to_value(&node(&task, "bootstrap").task).unwrap()["links"], 2);
    let noisy = changed("[loop]", "[task]\nnoise = 0.5\n\n[loop]");
    assert_eq!(
        serde_json::to_value(&node(&noisy, "bootstrap").task).unwrap(),
        json!({ "env": "planar", "noise": 0.5 })
    );
}

#[test]
fn stages_and_axes_can_be_added_and_lists_are_replaced() {
    let more = "[stages.extra]\nkind = \"generate_data\"\nstream = \"extra\"\n\n[stages.represent]\n";
    let more = changed("[stages.represent]\n", &format!("{more}inputs.transitions = [\"bootstrap\", \"extra\"]\n"));
    assert_eq!(taken(&more, "represent@2", "transitions"), ["bootstrap", "extra"]);
    let swept = graph(&format!("{SHORT}\n[matrix]\nseed = [1, 2]\n"), &[], &["seed=3"]);
    assert!(swept.nodes.iter().all(|node| node.stream.seed == 3));
}

#[test]
fn a_stage_of_the_base_and_an_input_can_be_left_out() {
    let without = "[stages]\ndistill = false\ncontrol.inputs.start = []\n\n[stages.represent]\n";
    let without = changed("[stages.represent]\n", without);
    assert!(without.nodes.iter().all(|node| node.stage != "distill"));
    assert_eq!(taken(&without, "control@1", "start"), [""; 0]);
    let carried = SHORT.replacen("[stages.represent]\n", "[stages]\ndistill = false\n\n[stages.represent]\n", 1);
    let carried = graph(&carried, &["control.inputs.start=control@prev"], &[]);
    assert_eq!(taken(&carried, "control@2", "start"), ["control@1"]);
}

#[test]
fn arguments_change_what_the_two_files_say_together() {
    let graph = graph(SHORT, &["represent.epochs=9", "bootstrap.samples=5"], &["represent.lambda.curvature=1,2"]);
    assert_eq!(node(&graph, "bootstrap").params["samples"], 5);
    assert_eq!(node(&graph, "represent@1[represent.lambda.curvature=2]").params["epochs"], 9);
}

#[test]
fn the_base_is_kept_with_its_text() {
    let alone = graph(SHORT, &[], &[]);
    let base = alone.members[0].base.as_ref().expect("a base");
    assert_eq!(base.file, "folder/online.toml");
    assert!(base.text.contains("Online CARL on planar navigation"));
    assert!(graph(ONLINE, &[], &[]).members[0].base.is_none());
    let text = serde_json::to_value(&alone.members[0]).unwrap();
    assert_eq!(text["base"]["file"], "folder/online.toml");
}

#[test]
fn a_member_of_a_suite_may_extend_a_file_beside_it() {
    let suite = "schema = 1\nname = \"s\"\n[suite.one]\npipeline = \"sub/short.toml\"\nset = { map.first = {} }\n";
    let graph = graph(suite, &["one.collect.samples=7"], &[]);
    assert_eq!(node(&graph, "one/collect@1").params["samples"], 7);
    assert_eq!(node(&graph, "one/represent@1").params["epochs"], 2);
    let member = &graph.members[0];
    assert_eq!((&*member.file, &*member.text), ("folder/sub/short.toml", SHORT));
    assert_eq!(member.base.as_ref().map(|base| &*base.file), Some("folder/sub/online.toml"));
}

#[test]
fn an_absolute_path_is_taken_as_it_is() {
    assert_eq!(changed("\"online.toml\"", "\"/home/online.toml\"").nodes.len(), graph(SHORT, &[], &[]).nodes.len());
}

#[test]
fn mistakes_stand_in_the_file_that_they_were_written_in() {
    let wrong = |from: &str, to: &str| {
        assert!(SHORT.contains(from), "{from}");
        try_load(&SHORT.replacen(from, to, 1), &[], &[]).unwrap_err().render(false)
    };
    let base = |name: &str| wrong("online.toml", name);
    let argued = |set: &[&str]| try_load(SHORT, set, &[]).unwrap_err().render(false);
    let suite = "schema = 1\nname = \"s\"\nextends = \"suite.toml\"\n[suite.one]\npipeline = \"sub/short.toml\"\n";
    let cases = [
        ("a base that is not there", base("online.tml")),
        ("a base that is no TOML", base("none.toml")),
        ("a base without a schema", base("no_schema.toml")),
        ("a base that is a suite", base("suite.toml")),
        ("the file itself", base("short.toml")),
        ("the file itself by another path", base("./short.toml")),
        ("a base that extends another file", base("sub/short.toml")),
        ("the wrong type", wrong("\"online.toml\"", "[\"online.toml\"]")),
        ("a suite that extends", try_load(suite, &[], &[]).unwrap_err().render(false)),
        ("no name", wrong("name = \"short\"\n", "")),
        ("a mistake in the base", base("wrong.toml")),
        ("a mistake in the file", wrong("epochs = 2", "epoch = 2")),
        ("mistakes in both", wrong("online.toml\"", "wrong.toml\"\nsede = 3")),
        ("a stage that is not in the base", wrong("stages.represent", "stages.represents")),
        ("no stage to leave out", wrong("[stages.represent]", "[stages]\ndistil = false\n\n[stages.represent]")),
        ("an option of the base's task", wrong("[loop]", "[task]\nenv = \"planar\"\ntorque = 1.0\n\n[loop]")),
        ("an argument", argued(&["represnt.epochs=3", "represent.epochs=x"])),
    ];
    let mut text = String::new();
    for (name, rendered) in &cases {
        text += &format!("## {name}\n{rendered}\n");
    }
    let path = "tests/it/pipeline/mistakes/extends.txt";
    if std::env::var_os("UPDATE_SNAPSHOTS").is_some() {
        fs::write(path, &text).unwrap();
    }
    assert!(text == fs::read_to_string(path).unwrap_or_default(), "{path} differs; now it is:\n{text}");
}
