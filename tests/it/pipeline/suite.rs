//! A suite: several pipelines in one graph, what it changes in them, and its mistakes where they stand.

use std::fs;

use crate::support::pipeline::{ONLINE, kinds, node, overrides, taken};
use carl_pipe::{
    diag::Diagnostics,
    pipeline::{Graph, Source, load_with},
    run::{key::without_inputs, node::Work},
    stage::NothingOutside,
};

const SUITE: &str = r#"schema = 1
name = "both"
seeds = "0..3"

[suite.online]
pipeline = "online.toml"
labels = { algorithm = "online CARL" }

[suite.short]
pipeline = "online.toml"
seeds = [7]
set = { rounds = 2, "represent.epochs" = 3, represent = { first = { epochs = 4 } }, evaluate.episodes = 1 }

[suite.one]
pipeline = "one.toml"
"#;

const ONE: &str = r#"schema = 1
name = "one"
seed = 5

[labels]
algorithm = "none"
size = 3

[task]
env = "planar"

[stages.data]
kind = "generate_data"
"#;

fn try_load(text: &str, set: &[&str], sweep: &[&str]) -> Result<Graph, Diagnostics> {
    let read = |path: &str| match path {
        "online.toml" => Ok(Source::new(format!("folder/{path}"), ONLINE.as_bytes().to_vec())),
        "one.toml" => Ok(Source::new(format!("folder/{path}"), ONE.as_bytes().to_vec())),
        "broken.toml" => Ok(Source::new(format!("folder/{path}"), ONE.replace("kind", "kid").into_bytes())),
        "none.toml" => Ok(Source::new(format!("folder/{path}"), b"name = ".to_vec())),
        "suite.toml" => Ok(Source::new(format!("folder/{path}"), SUITE.as_bytes().to_vec())),
        _ => Err("No such file or directory".to_owned()),
    };
    load_with(&Source::new("s.toml", text), &overrides(set, sweep), kinds(), &read, &NothingOutside)
}

fn suite(set: &[&str], sweep: &[&str]) -> Graph {
    try_load(SUITE, set, sweep).unwrap_or_else(|mistakes| panic!("{}", mistakes.render(false)))
}

#[test]
fn nodes_stand_behind_their_members_and_keep_their_own_inputs() {
    let graph = suite(&[], &[]);
    assert!(graph.is_suite());
    assert_eq!(taken(&graph, "online/represent@1[seed=2]", "warm_start"), ["online/represent@0[seed=2]"]);
    assert_eq!(
        taken(&graph, "short/represent@1[seed=7]", "transitions"),
        ["short/bootstrap[seed=7]", "short/collect@1[seed=7]"]
    );
    let names: std::collections::BTreeSet<_> = graph.nodes.iter().map(|node| &node.name).collect();
    assert_eq!(names.len(), graph.nodes.len());
    assert_eq!(graph.nodes.iter().filter(|node| node.name.starts_with("one/")).count(), 3);
    let files: Vec<_> = graph.members.iter().map(|member| (&*member.name, &*member.pipeline, &*member.file)).collect();
    assert_eq!(files[2], ("one", "one", "folder/one.toml"));
    assert!(graph.members[2].text.contains("generate_data"));
}

#[test]
fn a_member_has_its_seeds_its_values_and_its_labels() {
    let graph = suite(&[], &[]);
    let short = node(&graph, "short/represent@1[seed=7]");
    assert_eq!((&short.params["epochs"], short.stream.seed), (&serde_json::json!(3), 7));
    assert_eq!(node(&graph, "short/represent@0[seed=7]").params["epochs"], 4);
    assert_eq!(node(&graph, "online/represent@1[seed=0]").params["epochs"], 15);
    assert!(graph.nodes.iter().all(|node| node.name != "short/represent@2[seed=7]"));
    let label = |member: usize, name: &str| graph.members[member].labels.get(name).map(String::as_str);
    assert_eq!((label(0, "algorithm"), label(1, "algorithm")), (Some("online CARL"), None));
    assert_eq!((label(2, "algorithm"), label(2, "size")), (Some("none"), Some("3")));
}

#[test]
fn values_of_the_suite_reach_the_members_that_have_the_stage_and_have_not_set_them() {
    let with = |set: &str| SUITE.replace("seeds = \"0..3\"", &format!("seeds = \"0..3\"\nset = {{ {set} }}"));
    let graph = try_load(&with("rounds = 3, \"represent.epochs\" = 6, data.samples = 9"), &[], &[]).unwrap();
    let epochs = |name: &str| node(&graph, name).params["epochs"].clone();
    assert_eq!((epochs("online/represent@1[seed=0]"), epochs("short/represent@1[seed=7]")), (6.into(), 3.into()));
    assert_eq!(node(&graph, "one/data[seed=0]").params["samples"], 9);
    assert!(graph.nodes.iter().any(|node| node.name == "online/represent@2[seed=0]"));
    assert!(graph.nodes.iter().all(|node| node.name != "online/represent@3[seed=0]"));
    assert!(graph.nodes.iter().all(|node| node.name != "short/represent@2[seed=7]"));
    // The command line wins.
    let graph = try_load(&with("\"represent.epochs\" = 6"), &["represent.epochs=8"], &[]).unwrap();
    assert_eq!(node(&graph, "online/represent@1[seed=0]").params["epochs"], 8);
    let mistakes = try_load(&with("represend.epochs = 6"), &[], &[]).unwrap_err().render(false);
    assert!(mistakes.contains("no pipeline of the suite has a stage `represend`"), "{mistakes}");
    assert!(mistakes.contains("did you mean `represent`?"), "{mistakes}");
}

#[test]
fn arguments_reach_the_members_that_they_concern() {
    let graph = suite(&["represent.epochs=9", "short.evaluate.episodes=2", "one/data.samples=3"], &["seed=1,2"]);
    assert_eq!(node(&graph, "online/represent@1[seed=1]").params["epochs"], 9);
    assert_eq!(node(&graph, "short/represent@1[seed=2]").params["epochs"], 9);
    assert_eq!(node(&graph, "short/evaluate@1[seed=1]").params["episodes"], 2);
    assert_eq!(node(&graph, "online/evaluate@1[seed=1]").params["episodes"], 10);
    assert_eq!(node(&graph, "one/data[seed=1]").params["samples"], 3);
    let graph = suite(&["seed=4"], &[]);
    assert_eq!(node(&graph, "one/data").stream.seed, 4);
    let graph = suite(&[], &["short.represent.epochs=1,2"]);
    assert!(graph.nodes.iter().any(|node| node.name == "short/represent@1[seed=7,represent.epochs=2]"));
}

#[test]
fn targets_name_members_stages_of_members_and_stages_of_all() {
    let graph = suite(&[], &[]);
    let count = |target: &str| (0..graph.nodes.len()).filter(|&id| graph.is_named(id, target)).count();
    assert_eq!((count("one"), count("one/data"), count("short/evaluate"), count("evaluate")), (3, 3, 2, 3 * 17 + 2));
    assert_eq!((count("short/map@1[seed=7]"), count("nothing")), (1, 0));
}

#[test]
fn labels_reach_no_node() {
    let plain = suite(&[], &[]);
    let labelled = try_load(&SUITE.replace("online CARL", "another"), &[], &[]).unwrap();
    let keys = |graph: &Graph| graph.nodes.iter().map(|node| without_inputs(&Work::of(node))).collect::<Vec<_>>();
    assert_eq!(keys(&plain), keys(&labelled));
}

#[test]
fn mistakes_stand_in_the_suite_in_the_member_or_in_the_argument() {
    let changed = |from: &str, to: &str| {
        assert!(SUITE.contains(from), "{from}");
        try_load(&SUITE.replacen(from, to, 1), &[], &[]).unwrap_err().render(false)
    };
    let argued = |set: &[&str], sweep: &[&str]| try_load(SUITE, set, sweep).unwrap_err().render(false);
    let cases = [
        ("unknown key", changed("seeds = \"0..3\"", "sedes = \"0..3\"")),
        ("what belongs to a pipeline", changed("seeds = \"0..3\"", "seed = 3\npreset = \"paper\"")),
        ("unknown key of a member", changed("seeds = [7]", "sede = [7]")),
        ("no pipeline", changed("pipeline = \"one.toml\"", "")),
        ("a pipeline that is not there", changed("one.toml", "two.toml")),
        ("a suite in a suite", changed("one.toml", "suite.toml")),
        ("no members", try_load("schema = 1\nname = \"s\"\n[suite]\n", &[], &[]).unwrap_err().render(false)),
        ("a bad range", changed("0..3", "3..0")),
        ("a bad value", changed("evaluate.episodes = 1", "evaluate.episodes = \"many\"")),
        ("a bad parameter", changed("\"represent.epochs\" = 3", "\"represent.epocs\" = 3")),
        ("a stage that is not there", changed("\"represent.epochs\"", "\"represents.epochs\"")),
        ("a bad label", changed("\"online CARL\"", "[1]")),
        (
            "a mistake in a member's file, named twice",
            changed("one.toml\"", "broken.toml\"\n[suite.again]\npipeline = \"broken.toml\""),
        ),
        ("a member that is no TOML", changed("one.toml", "none.toml")),
        ("an argument for nobody", argued(&["represnt.epochs=3"], &[])),
        ("a bad argument, once for all members", argued(&["represent.epocs=3"], &[])),
        ("an argument without a value", argued(&["seed"], &[])),
        ("all at once", argued(&["x.y=1", "one.data.sample=3"], &[])),
    ];
    let mut text = String::new();
    for (name, rendered) in &cases {
        text += &format!("## {name}\n{rendered}\n");
    }
    let path = "tests/it/pipeline/mistakes/suite.txt";
    if std::env::var_os("UPDATE_SNAPSHOTS").is_some() {
        fs::write(path, &text).unwrap();
    }
    assert!(text == fs::read_to_string(path).unwrap_or_default(), "{path} differs; now it is:\n{text}");
}
