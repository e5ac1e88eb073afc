//! What a pipeline file unrolls into.

use crate::support::pipeline::{ONLINE, graph, graph_with, node, taken, try_load};
use serde_json::json;

#[test]
fn the_online_pipeline_unrolls_round_by_round() {
    let graph = graph(ONLINE);
    assert_eq!(graph.nodes.len(), 1 + 17 * 4 + 16 * 2);
    let names: Vec<&str> = graph.nodes.iter().take(12).map(|node| node.name.as_str()).collect();
    assert_eq!(
        names,
        [
            "bootstrap",
            "represent@0",
            "control@0",
            "evaluate@0",
            "map@0",
            "collect@1",
            "represent@1",
            "distill@1",
            "control@1",
            "evaluate@1",
            "map@1",
            "collect@2"
        ]
    );
    assert_eq!(taken(&graph, "collect@1", "model"), ["represent@0"]);
    assert_eq!(taken(&graph, "represent@0", "transitions"), ["bootstrap"]);
    assert_eq!(taken(&graph, "represent@0", "warm_start"), [""; 0]);
    assert_eq!(taken(&graph, "represent@2", "transitions"), ["bootstrap", "collect@1", "collect@2"]);
    assert_eq!(taken(&graph, "represent@2", "warm_start"), ["represent@1"]);
    assert_eq!(taken(&graph, "control@0", "start"), [""; 0]);
    assert_eq!(taken(&graph, "control@3", "start"), ["distill@3"]);
    assert!(node(&graph, "evaluate@16").is_last && node(&graph, "bootstrap").is_last);
    assert!(!node(&graph, "evaluate@15").is_last);
}

#[test]
fn every_input_comes_before_what_takes_it() {
    let graph = graph_with(ONLINE, &[], &["seed=0..3", "represent.lambda.consistency=7,11"]);
    for (at, node) in graph.nodes.iter().enumerate() {
        assert!(node.inputs.iter().all(|(_, givers)| givers.iter().all(|giver| *giver < at)), "{}", node.name);
    }
}

#[test]
fn parameters_are_explicit_and_first_counts_in_the_first_round_alone() {
    let graph = graph(ONLINE);
    let params = |epochs: u64| {
        json!({ "objective": "carl", "epochs": epochs, "learning_rate": 0.0005,
                "lambda": { "consistency": 8.0, "curvature": 1.0 } })
    };
    assert_eq!(node(&graph, "represent@0").params, params(400));
    assert_eq!(node(&graph, "represent@1").params, params(15));
    assert_eq!(node(&graph, "represent@16").params, params(15));
}

#[test]
fn the_first_round_of_a_stage_that_begins_later_is_its_own() {
    let graph = graph(&ONLINE.replace("samples = 128", "samples = 128\nfirst = { samples = 5 }"));
    assert_eq!(node(&graph, "collect@1").params, json!({ "samples": 5 }));
    assert_eq!(node(&graph, "collect@2").params, json!({ "samples": 128 }));
}

#[test]
fn more_rounds_leave_the_earlier_ones_as_they_are() {
    let (few, many) = (graph(ONLINE), graph_with(ONLINE, &["rounds=19"], &[]));
    for old in &few.nodes {
        let new = node(&many, &old.name);
        assert_eq!((&old.params, &old.task, &old.stream), (&new.params, &new.task, &new.stream));
        for ((port, old_givers), (_, new_givers)) in old.inputs.iter().zip(&new.inputs) {
            let names = |graph: &carl_pipe::pipeline::Graph, givers: &[usize]| {
                givers.iter().map(|giver| graph.nodes[*giver].name.clone()).collect::<Vec<_>>()
            };
            assert_eq!(names(&few, old_givers), names(&many, new_givers), "{} {}", old.name, port.name);
        }
    }
}

/// A pipeline in other words: kinds, parameters, tasks, streams and connections, without names.
fn meaning(text: &str) -> Vec<String> {
    let graph = graph(text);
    let described = graph.nodes.iter().map(|node| {
        let inputs: Vec<_> = node.inputs.iter().map(|(port, givers)| (port.name, givers)).collect();
        format!("{} {} {:?} {:?} {inputs:?}", node.kind.name, node.params, node.task, node.stream)
    });
    described.collect()
}

#[test]
fn spaces_and_comments_change_nothing() {
    let other = ONLINE.replace(" = ", "   =  ").replace('\n', "  # a note\n\n");
    assert_eq!(meaning(&other), meaning(ONLINE));
}

#[test]
fn line_endings_and_a_byte_order_mark_change_nothing() {
    let other = format!("\u{feff}{}", ONLINE.replace('\n', "\r\n"));
    assert_eq!(meaning(&other), meaning(ONLINE));
    let wrong = other.replace("epochs = 15", "epoch = 15");
    let place = &try_load(&wrong, &[], &[]).unwrap_err().to_json()[0];
    assert_eq!((&place["line"], &place["message"]), (&json!(28), &json!("`train_lce` has no parameter `epoch`")));
}

#[test]
fn the_order_of_keys_changes_nothing() {
    let other = ONLINE.replace(
        "kind = \"evaluate\"\nloop = true\ninputs = { model = \"represent\", agent = \"control\" }\nepisodes = 10",
        "episodes = 10\ninputs = { agent = \"control\", model = \"represent\" }\nkind = \"evaluate\"\nloop = true",
    );
    assert_ne!(other, ONLINE);
    assert_eq!(meaning(&other), meaning(ONLINE));
}

#[test]
fn a_default_written_out_changes_nothing() {
    let other = ONLINE.replace("epochs = 15", "epochs = 15\nlearning_rate = 5e-4\nlambda.consistency = 8");
    assert_ne!(other, ONLINE);
    assert_eq!(meaning(&other), meaning(ONLINE));
    assert_eq!(meaning(&ONLINE.replace("env = \"planar\"", "env = \"planar\"\nnoise = 0")), meaning(ONLINE));
}

#[test]
fn a_whole_number_is_the_same_float() {
    let with =
        |value: &str| meaning(&ONLINE.replace("epochs = 15", &format!("epochs = 15\nlambda.curvature = {value}")));
    assert_eq!(with("3"), with("3.0"));
    assert_eq!(with("3"), with("0x3"));
    assert_ne!(with("3"), with("4"));
}

#[test]
fn renaming_a_stage_changes_nothing() {
    let other = ONLINE.replace("represent", "encoder");
    assert_eq!(meaning(&other), meaning(ONLINE));
}

#[test]
fn a_preset_fills_what_is_not_written() {
    let paper = graph(&ONLINE.replace("epochs = 15\n", "").replace("\"recipe\"", "\"paper\""));
    assert_eq!(node(&paper, "represent@0").params["epochs"], 400);
    assert_eq!(node(&paper, "represent@1").params["epochs"], 2000);
}

#[test]
fn streams_hold_seed_kind_and_round() {
    let graph = graph_with(ONLINE, &["seed=7", "represent.stream=second"], &[]);
    let stream = serde_json::to_value(&node(&graph, "represent@3").stream).unwrap();
    assert_eq!(stream, json!({ "seed": 7, "kind": "train_lce", "round": 3, "stream": "second" }));
}

#[test]
fn arguments_change_the_file_as_if_it_said_so() {
    let set =
        ["represent.epochs=3", "represent.first.epochs=2", "represent.objective=pcc", "task.noise=0.5", "rounds=2"];
    let graph = graph_with(ONLINE, &set, &[]);
    assert_eq!(node(&graph, "represent@0").params["epochs"], 2);
    assert_eq!(node(&graph, "represent@1").params["epochs"], 3);
    assert_eq!(node(&graph, "represent@1").params["objective"], "pcc");
    assert_eq!(node(&graph, "represent@1").params["lambda"]["consistency"], 7.0);
    assert_eq!(node(&graph, "represent@1").task.number("noise"), 0.5);
    assert_eq!(graph.nodes.len(), 1 + 2 * 4 + 2);
}

#[test]
fn an_axis_multiplies_only_what_it_reaches() {
    let graph = graph_with(ONLINE, &["rounds=2"], &["represent.lambda.consistency=7,11"]);
    let names: Vec<&str> =
        graph.nodes.iter().filter(|node| node.stage != "map").map(|node| node.name.as_str()).collect();
    assert_eq!(names.len(), 1 + 2 * (3 + 3 + 2));
    assert_eq!(node(&graph, "bootstrap").point, []);
    let name = "control@1[represent.lambda.consistency=11]";
    assert_eq!(taken(&graph, name, "model"), ["represent@1[represent.lambda.consistency=11]"]);
    assert_eq!(taken(&graph, name, "transitions")[0], "bootstrap");
    let params = |value: u64| &node(&graph, &format!("represent@1[represent.lambda.consistency={value}]")).params;
    assert_eq!(params(11)["lambda"]["consistency"], 11.0);
    assert_eq!(params(7)["lambda"]["consistency"], 7.0);
}

#[test]
fn a_parameter_that_first_sets_is_no_axis_in_the_first_round() {
    let graph = graph_with(ONLINE, &["rounds=2"], &["represent.epochs=1,2"]);
    assert_eq!(node(&graph, "represent@0").params["epochs"], 400);
    assert_eq!(node(&graph, "represent@1[represent.epochs=2]").params["epochs"], 2);
    assert_eq!(taken(&graph, "represent@1[represent.epochs=2]", "warm_start"), ["represent@0"]);
    let graph = graph_with(ONLINE, &["rounds=2"], &["represent.first.epochs=1,2"]);
    assert_eq!(node(&graph, "represent@0[represent.first.epochs=2]").params["epochs"], 2);
    assert_eq!(node(&graph, "represent@1[represent.first.epochs=2]").params["epochs"], 15);
}

#[test]
fn seeds_tasks_and_presets_can_be_axes() {
    let graph = graph_with(ONLINE, &["rounds=1"], &["seed=3..5", "task.noise=0,0.5", "preset=recipe,paper"]);
    // `represent@0` sets its epochs by `first`, so no preset reaches anything.
    assert_eq!(graph.nodes.len(), 5 * 4);
    let node = node(&graph, "represent@0[seed=4,task.noise=0.5]");
    assert_eq!((node.stream.seed, node.task.number("noise")), (4, 0.5));
    let point: Vec<(&str, &str)> = node.point.iter().map(|(axis, value)| (axis.as_str(), value.as_str())).collect();
    assert_eq!(point, [("seed", "4"), ("task.noise", "0.5")]);
}

const SUMMARY: &str = "\n[stages.summary]\nkind = \"summarize\"\ninputs = { evaluations = \"evaluate@last[*]\" }\n";

#[test]
fn a_star_takes_from_all_points_and_stands_outside_of_the_matrix() {
    let text = format!("{ONLINE}{SUMMARY}\n[matrix]\nseed = \"0..3\"\n");
    let graph = graph_with(&text, &["rounds=2"], &[]);
    let taken = taken(&graph, "summary", "evaluations");
    assert_eq!(taken, ["evaluate@1[seed=0]", "evaluate@1[seed=1]", "evaluate@1[seed=2]"]);
    assert_eq!(node(&graph, "summary").point, []);
}

#[test]
fn an_axis_is_written_quoted_dotted_or_as_a_table() {
    let names = |matrix: &str| -> Vec<String> {
        let graph = graph_with(&format!("{ONLINE}\n{matrix}"), &["rounds=1"], &[]);
        graph.nodes.iter().map(|node| node.name.clone()).collect()
    };
    let quoted = names("[matrix]\n\"represent.lambda.consistency\" = [7, 11]\n");
    assert_eq!(quoted, names("[matrix]\nrepresent.lambda.consistency = [7, 11]\n"));
    assert_eq!(quoted, names("[matrix.represent]\nlambda = { consistency = [7, 11] }\n"));
}

#[test]
fn a_sweep_replaces_the_axis_of_the_file() {
    let text = format!("{ONLINE}\n[matrix]\nseed = \"0..25\"\n");
    let graph = graph_with(&text, &["rounds=1"], &["seed=8,9"]);
    assert_eq!(graph.nodes.len(), 10);
}

#[test]
fn all_rounds_and_one_round_can_be_taken_from_outside_of_the_loop() {
    for (reference, wanted) in [
        ("evaluate@all", &["evaluate@0", "evaluate@1"][..]),
        ("evaluate@last", &["evaluate@1"]),
        ("evaluate@0", &["evaluate@0"]),
    ] {
        let text = format!("{ONLINE}{}", SUMMARY.replace("evaluate@last[*]", reference));
        let graph = graph_with(&text, &["rounds=2"], &[]);
        assert_eq!(taken(&graph, "summary", "evaluations"), wanted);
    }
}

#[test]
fn the_task_can_be_left_to_an_axis() {
    let text = ONLINE.replace("[task]\nenv = \"planar\"\n", "");
    let graph = graph_with(&format!("{text}{SUMMARY}"), &["rounds=1"], &["task.env=planar", "task.noise=0,1"]);
    assert_eq!(node(&graph, "bootstrap[task.env=planar,task.noise=1]").task.number("noise"), 1.0);
    assert_eq!(node(&graph, "summary").task.number("noise"), 0.0);
}

#[test]
fn stages_that_are_compared_may_share_their_randomness() {
    let second = "\n[stages.again]\nkind = \"evaluate\"\nloop = true\n\
                  inputs = { model = \"represent\", agent = \"control@0\" }\n";
    let summary = SUMMARY.replace("\"evaluate@last[*]\"", "[\"evaluate@last\", \"again@last\"]");
    let graph = graph(&format!("{ONLINE}{second}{summary}"));
    assert_eq!(node(&graph, "again@3").stream, node(&graph, "evaluate@3").stream);
    assert_eq!(taken(&graph, "summary", "evaluations"), ["evaluate@16", "again@16"]);
}

#[test]
fn a_stream_tells_two_sources_apart() {
    let text = ONLINE.replacen("\"bootstrap\", ", "\"bootstrap\", \"more\", ", 1);
    let graph = graph(&format!("{text}\n[stages.more]\nkind = \"generate_data\"\nstream = \"more\"\n"));
    assert_ne!(node(&graph, "more").stream, node(&graph, "bootstrap").stream);
}

#[test]
fn a_stage_in_the_loop_sees_no_later_round() {
    let text = ONLINE.replace("warm_start = \"represent@prev\"", "warm_start = \"represent@2\"");
    assert!(try_load(&text, &[], &[]).is_err(), "in round 2 it would take its own result");
    let text = ONLINE.replace("start = \"distill\"", "start = \"distill@2\"");
    let graph = graph_with(&text, &["rounds=4"], &[]);
    assert_eq!(taken(&graph, "control@1", "start"), [""; 0]);
    assert_eq!(taken(&graph, "control@3", "start"), ["distill@2"]);
}
