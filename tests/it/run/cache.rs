//! The cache: no node runs twice, no damaged output is used, and damage reruns only the node that made the output.

use std::fs;

use crate::support::{
    run::{Bench, Ear, chain, count, damage, graph, record, run, state},
    small_disk::SmallDisk,
};
use carl_pipe::{
    run::{
        events::NodeState::{Cached, Failed, Ran},
        execute::{Failure, Options},
        plan::{Force, plan, select},
        why::{History, Reason, reason},
    },
    store::LocalStore,
};
use serde_json::json;

#[test]
fn a_second_run_executes_nothing() {
    let bench = Bench::new();
    let (first, _) = bench.run(&chain(1));
    assert_eq!(first.count(Ran), 3);
    assert_eq!(fs::read_to_string(first.path.join("c.number.txt")).unwrap(), "111");
    let (second, ear) = bench.run(&chain(1));
    assert_eq!((second.count(Cached), ear.ran()), (3, Vec::<String>::new()));
}

#[test]
fn a_node_that_reruns_to_equal_bytes_stops_the_wave() {
    let bench = Bench::new();
    let parity = |plus: i64| {
        let modulo = json!({"modulo": 2});
        graph(&[("a", json!({"plus": plus}), &[]), ("b", modulo, &["a"]), ("c", json!({"plus": 5}), &["b"])])
    };
    bench.run(&parity(1));
    let (report, ear) = bench.run(&parity(3));
    assert_eq!(ear.ran(), ["a", "b"]);
    assert_eq!(state(&report, "c"), Cached);
}

#[test]
fn changing_a_parameter_reruns_exactly_its_cone() {
    let bench = Bench::new();
    let two = |plus: i64| {
        let sum: &[&str] = &["left", "right"];
        graph(&[("left", json!({"plus": 1}), &[]), ("right", json!({"plus": plus}), &[]), ("sum", json!({}), sum)])
    };
    bench.run(&two(2));
    let (_, ear) = bench.run(&two(3));
    assert_eq!(ear.ran(), ["right", "sum"]);
}

#[test]
fn renaming_a_node_reruns_nothing() {
    let bench = Bench::new();
    bench.run(&graph(&[("a", json!({"plus": 1}), &[]), ("b", json!({}), &["a"])]));
    let (report, _) = bench.run(&graph(&[("first", json!({"plus": 1}), &[]), ("second", json!({}), &["first"])]));
    assert_eq!(report.count(Cached), 2);
}

#[test]
fn a_deleted_object_reruns_only_its_maker() {
    let bench = Bench::new();
    let (report, _) = bench.run(&chain(1));
    fs::remove_file(bench.object(&report, "b")).unwrap();
    let (_, ear) = bench.run(&chain(1));
    assert_eq!(ear.ran(), ["b"]);
}

#[test]
fn a_damaged_object_is_put_aside_and_reruns_only_its_maker() {
    let bench = Bench::new();
    let (report, _) = bench.run(&chain(1));
    damage(&bench.object(&report, "b"));
    let (again, ear) = bench.run(&chain(1));
    assert_eq!(ear.ran(), ["b"]);
    assert_eq!(fs::read_to_string(again.path.join("b.number.txt")).unwrap(), "11");
    assert_eq!(fs::read_dir(bench.store.root().join("bad")).unwrap().count(), 1);
    assert_eq!(bench.run(&chain(1)).0.count(Cached), 3);
}

#[test]
fn an_input_damaged_under_way_is_made_again_within_the_run() {
    let bench = Bench::new();
    let (first, _) = bench.run(&graph(&[("a", json!({"plus": 1}), &[])]));
    let behaviour = format!("damage:{}", bench.object(&first, "a").display());
    let graph = graph(&[
        ("a", json!({"plus": 1}), &[]),
        ("vandal", json!({"behaviour": behaviour}), &[]),
        ("c", json!({"plus": 5}), &["vandal", "a"]),
    ]);
    let (report, ear) = bench.run(&graph);
    assert_eq!(ear.ran(), ["vandal", "a", "c"]);
    assert_eq!(ear.warnings(), ["the output of a cannot be used: its number.txt is damaged; making it again"]);
    assert_eq!(fs::read_to_string(report.path.join("c.number.txt")).unwrap(), "6");
}

#[test]
fn lost_recordings_are_told_in_one_warning_each_time() {
    let bench = Bench::new();
    let (report, _) = bench.run(&chain(1));
    fs::remove_file(fs::canonicalize(report.path.join("b.mcap")).unwrap()).unwrap();
    let (again, ear) = bench.run(&chain(1));
    assert_eq!(again.count(Cached), 3);
    assert_eq!(
        ear.warnings(),
        ["its result is cached without a recording; `carl-pipe verify --repair` makes the recording again"]
    );
    assert!(again.path.join("a.mcap").exists() && !again.path.join("b.mcap").exists());
    fs::remove_file(fs::canonicalize(again.path.join("c.mcap")).unwrap()).unwrap();
    for _ in 0..2 {
        let (_, ear) = bench.run(&chain(1));
        assert_eq!(
            ear.warnings(),
            ["2 cached nodes have no recording; `carl-pipe verify --repair` makes the recordings again"]
        );
    }
    let (_, ear) = bench.run_with(&chain(1), &Options { force: Force::Unrecorded, ..Options::default() });
    assert_eq!((ear.ran(), ear.warnings().len()), (vec!["b".to_owned(), "c".to_owned()], 0));
    let (healed, ear) = bench.run(&chain(1));
    assert!(healed.path.join("b.mcap").exists() && ear.warnings().is_empty());
    let digests = |report, node| (record(report, node).outcome.output, record(report, node).outcome.recording);
    assert_eq!(["b", "c"].map(|node| digests(&healed, node)), ["b", "c"].map(|node| digests(&report, node)));
}

#[test]
fn a_damaged_entry_is_a_miss() {
    let bench = Bench::new();
    let (report, _) = bench.run(&chain(1));
    for (damaged, times) in [("empty", 0), ("cut", 40), ("flipped", usize::MAX)] {
        let path = bench.entry(&report, "b");
        let mut bytes = fs::read(&path).unwrap();
        if times == usize::MAX {
            bytes[200] ^= 4
        } else {
            bytes.truncate(times)
        }
        fs::remove_file(&path).unwrap();
        fs::write(&path, bytes).unwrap();
        assert_eq!(bench.run(&chain(1)).1.ran(), ["b"], "{damaged}");
    }
}

#[test]
fn a_copied_store_is_still_fresh() {
    let bench = Bench::new();
    bench.run(&chain(1));
    let copy = bench.path("elsewhere");
    let status = std::process::Command::new("cp").arg("-r").arg(bench.store.root()).arg(&copy).status().unwrap();
    assert!(status.success());
    let store = LocalStore::open(&copy).unwrap();
    for _ in 0..2 {
        let report = run(&store, &chain(1), &Options::default(), &Ear::default()).unwrap();
        assert_eq!(report.count(Cached), 3);
    }
}

#[test]
fn nodes_of_equal_key_run_once() {
    let bench = Bench::new();
    let trace = bench.path("trace");
    let params = json!({"plus": 1, "ticks": 4, "trace": trace});
    let (report, _) = bench.run(&graph(&[("a", params.clone(), &[]), ("b", params.clone(), &[]), ("c", params, &[])]));
    assert_eq!(count(&trace), 1);
    assert_eq!((report.count(Ran), report.count(Cached)), (1, 2));
}

#[test]
fn a_forced_node_runs_once_and_its_equal_output_stops_the_wave() {
    let bench = Bench::new();
    bench.run(&chain(1));
    let force = Force::Named(["b".to_owned()].into());
    let (report, ear) = bench.run_with(&chain(1), &Options { force, ..Options::default() });
    assert_eq!(ear.ran(), ["b"]);
    assert_eq!(report.count(Cached), 2);
}

#[test]
fn another_output_of_the_same_key_is_reported_and_the_first_counts() {
    let bench = Bench::new();
    let dice = bench.path("dice");
    fs::write(&dice, "3").unwrap();
    let throw = graph(&[("throw", json!({"behaviour": format!("read:{}", dice.display())}), &[])]);
    let (first, _) = bench.run(&throw);
    fs::write(&dice, "5").unwrap();
    let (second, ear) = bench.run_with(&throw, &Options { force: Force::All, ..Options::default() });
    assert_eq!(second.manifest.nodes[0].outcome.output, first.manifest.nodes[0].outcome.output);
    assert!(ear.warnings()[0].starts_with("`add` is not deterministic"), "{:?}", ear.warnings());
    // Once the first is lost, the second takes its place.
    fs::remove_file(bench.object(&first, "throw")).unwrap();
    let (third, _) = bench.run(&throw);
    assert_eq!(fs::read_to_string(third.path.join("throw.number.txt")).unwrap(), "5");
    assert_eq!(bench.run(&throw).0.count(Cached), 1);
}

#[test]
fn a_store_of_another_format_is_refused() {
    let bench = Bench::new();
    fs::write(bench.store.root().join("store.json"), r#"{"store":"carl-pipe","format":99}"#).unwrap();
    let error = LocalStore::open(bench.store.root()).unwrap_err().to_string();
    assert!(error.contains("is a store of format 99, but this carl-pipe reads format 1"), "{error}");
}

#[test]
fn the_plan_says_what_changed() {
    let bench = Bench::new();
    bench.run(&chain(7));
    let graph = chain(11);
    let wanted = select(&graph, &[]).unwrap();
    let plan = plan(&graph, &wanted, &bench.store, &Force::None).unwrap();
    let mut history = History::new(&bench.runs());
    let told: Vec<_> =
        (0..3).map(|id| reason(&graph, &plan, id, &mut history).as_ref().map(Reason::to_string).unwrap()).collect();
    assert_eq!(told, ["plus 7 -> 11", "waits for a", "waits for b"]);
}

#[test]
fn a_target_takes_what_it_needs_and_no_more() {
    let graph = graph(&[("a@0", json!({}), &[]), ("b@0", json!({}), &["a@0"]), ("a@1", json!({}), &["b@0"])]);
    assert_eq!(select(&graph, &["b".to_owned()]), Ok(vec![true, true, false]));
    assert_eq!(select(&graph, &["a@1".to_owned()]), Ok(vec![true, true, true]));
    assert_eq!(select(&graph, &["z".to_owned()]), Err("z".to_owned()));
}

#[test]
fn a_full_disk_is_told_and_publishes_nothing() {
    let bench = Bench::new();
    let Some(disk) = SmallDisk::mount(&bench.path("small"), 512) else {
        eprintln!("skipped: may not mount a small file system");
        return;
    };
    let store = LocalStore::open(&disk.path.join("artifacts")).unwrap();
    let big = |bytes: u64| graph(&[("big", json!({"ballast": bytes}), &[]), ("next", json!({}), &["big"])]);
    let report = run(&store, &big(2_000_000), &Options::default(), &Ear::default()).unwrap();
    assert_eq!(state(&report, "big"), Failed);
    let failure = report.ends[0].failure.clone().unwrap();
    let Failure::System(text) = failure else { panic!("{failure:?}") };
    assert!(text.contains("No space left on device"), "{text}");
    assert!(text.contains("cannot write") && text.contains("2000000 bytes"), "{text}");
    let report = run(&store, &big(1_000), &Options::default(), &Ear::default()).unwrap();
    assert_eq!(report.count(Ran), 2);
}
