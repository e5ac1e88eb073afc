//! Runs: a failure stops only what needs it, a stop publishes nothing, and a run can be replayed and removed.

use std::{
    fs,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    thread,
    time::Duration,
};

use crate::support::run::{Bench, Ear, chain, count, graph, kind, run, state};
use carl_pipe::{
    pipeline::Graph,
    run::{
        events::{
            NodeState::{Failed, Pending, Ran, Stopped},
            RunState,
        },
        execute::Options,
        manifest::Manifest,
        replay::replay,
        runs,
    },
    store::LocalStore,
};
use serde_json::json;

fn wide() -> Graph {
    let parts: Vec<String> = (0..12).map(|part| format!("part@{part}")).collect();
    let mut nodes: Vec<_> =
        parts.iter().map(|name| (name.as_str(), json!({"plus": name.len(), "name": name}), &[][..])).collect();
    let names: Vec<&str> = parts.iter().map(String::as_str).collect();
    nodes.push(("sum", json!({}), &names));
    graph(&nodes)
}

#[test]
fn the_number_of_jobs_changes_no_digest() {
    let (one, many) = (Bench::new(), Bench::new());
    let (first, _) = one.run_with(&wide(), &Options { jobs: 1, cores: 1, ..Options::default() });
    let (second, _) = many.run_with(&wide(), &Options { jobs: 8, cores: 2, ..Options::default() });
    let digests = |report: &carl_pipe::run::execute::Report| -> Vec<_> {
        report.manifest.nodes.iter().map(|node| (node.outcome.output, node.outcome.recording)).collect()
    };
    assert_eq!(digests(&first), digests(&second));
    // Neither do folder, time and number of jobs reach a key.
    let keys = |path| Manifest::read(path).unwrap().nodes.iter().map(|node| node.outcome.key).collect::<Vec<_>>();
    assert_eq!(keys(&first.path), keys(&second.path));
}

#[test]
fn a_failure_names_its_cause_and_stops_what_has_not_started() {
    let bench = Bench::new();
    let graph = graph(&[
        ("bad", json!({"behaviour": "fail:no numbers"}), &[]),
        ("after", json!({}), &["bad"]),
        ("apart", json!({}), &[]),
    ]);
    let options = Options { jobs: 1, ..Options::default() };
    let (report, _) = bench.run_with(&graph, &options);
    assert_eq!(report.state, RunState::Failed);
    assert_eq!(report.ends[0].failure.as_ref().unwrap().text(), "cannot add: no numbers");
    assert_eq!((state(&report, "bad"), state(&report, "after"), state(&report, "apart")), (Failed, Pending, Pending));
    let (report, _) = bench.run_with(&graph, &Options { keep_going: true, ..options });
    assert_eq!((state(&report, "after"), state(&report, "apart")), (Pending, Ran));
    assert!(report.path.join("live/bad.mcap").exists(), "what a failed node recorded is kept");
}

#[test]
fn a_panic_fails_only_its_node() {
    let bench = Bench::new();
    let graph = graph(&[("bad", json!({"behaviour": "panic:off by one"}), &[]), ("good", json!({"ticks": 5}), &[])]);
    let (report, _) = bench.run_with(&graph, &Options { keep_going: true, ..Options::default() });
    let text = report.ends[0].failure.as_ref().unwrap().text();
    assert!(text.starts_with("panicked at tests/it/support/run.rs:") && text.ends_with(": off by one"), "{text}");
    assert_eq!(state(&report, "good"), Ran);
}

#[test]
fn a_stop_publishes_nothing_and_the_same_command_goes_on() {
    let bench = Bench::new();
    let graph = graph(&[("a", json!({}), &[]), ("slow", json!({"ticks": 60}), &["a"]), ("c", json!({}), &["slow"])]);
    let stop = Arc::new(AtomicBool::new(false));
    let options = Options { stop: stop.clone(), ..Options::default() };
    let report = thread::scope(|scope| {
        let running = scope.spawn(|| bench.run_with(&graph, &options).0);
        thread::sleep(Duration::from_millis(150));
        stop.store(true, Ordering::Relaxed);
        running.join().unwrap()
    });
    assert_eq!(report.state, RunState::Interrupted);
    assert_eq!((state(&report, "a"), state(&report, "slow"), state(&report, "c")), (Ran, Stopped, Pending));
    let (report, ear) = bench.run(&graph);
    assert_eq!((report.state, ear.ran()), (RunState::Finished, vec!["slow".to_owned(), "c".to_owned()]));
}

#[test]
fn a_lone_node_gets_every_core() {
    let bench = Bench::new();
    let options = Options { jobs: 2, cores: 2, ..Options::default() };
    let (report, _) = bench.run_with(&graph(&[("a", json!({"behaviour": "all_cores:"}), &[])]), &options);
    assert_eq!(state(&report, "a"), Ran);
}

#[test]
fn runs_beside_each_other_on_one_store_execute_each_node_once() {
    let bench = Bench::new();
    let trace = bench.path("trace");
    let slow = |name: &str| json!({"ticks": 10, "trace": trace, "name": name});
    let graph = graph(&[("a", slow("a"), &[]), ("b", slow("b"), &[]), ("c", slow("c"), &["a", "b"])]);
    thread::scope(|scope| {
        let runs: Vec<_> = (0..4)
            .map(|_| {
                scope.spawn(|| {
                    let store = LocalStore::open(bench.store.root()).unwrap();
                    run(&store, &graph, &Options::default(), &Ear::default()).unwrap()
                })
            })
            .collect();
        for report in runs {
            assert_eq!(report.join().unwrap().state, RunState::Finished);
        }
    });
    assert_eq!(count(&trace), 3);
    assert_eq!(fs::read_dir(bench.store.root().join("locks")).unwrap().count(), 0);
}

#[test]
fn a_replay_gives_equal_digests() {
    let bench = Bench::new();
    let (report, _) = bench.run(&wide());
    let manifest = Manifest::read(&report.path).unwrap();
    let replayed = replay(&manifest, &bench.store, &bench.path("scratch"), &Options::default(), &kind, &()).unwrap();
    assert_eq!((replayed.equal, replayed.differences.len()), (13, 0));
    assert_eq!(replayed.report.count(Ran), 13);
}

#[test]
fn a_replay_names_the_first_file_that_differs() {
    let bench = Bench::new();
    let dice = bench.path("dice");
    fs::write(&dice, "3").unwrap();
    let throw = json!({"behaviour": format!("read:{}", dice.display())});
    let (report, _) =
        bench.run(&graph(&[("a", json!({}), &[]), ("throw", throw, &["a"]), ("c", json!({}), &["throw"])]));
    fs::write(&dice, "5").unwrap();
    let manifest = Manifest::read(&report.path).unwrap();
    let replayed = replay(&manifest, &bench.store, &bench.path("scratch"), &Options::default(), &kind, &()).unwrap();
    assert_eq!(replayed.equal, 1);
    let first = &replayed.differences[0];
    assert_eq!((first.node.as_str(), first.what.as_str()), ("throw", "number.txt"));
}

#[test]
fn runs_are_found_by_the_beginning_of_their_id() {
    let bench = Bench::new();
    let (first, _) = bench.run(&chain(1));
    thread::sleep(Duration::from_millis(2));
    let (second, _) = bench.run(&chain(1));
    let all = bench.runs();
    let ids: Vec<String> = runs::list(&all).unwrap().into_iter().map(|run| run.id).collect();
    assert_eq!(ids, [second.run.clone(), first.run.clone()]);
    assert_eq!(runs::find(&all, "latest").unwrap(), second.path);
    assert_eq!(runs::find(&all, &first.run[..first.run.len() - 1]).unwrap(), first.path);
    assert!(runs::find(&all, "2").unwrap_err().to_string().starts_with("2 runs begin with `2`"));
    assert_eq!(runs::find(&all, "x").unwrap_err().to_string(), "no run is called `x`");
    assert_eq!(runs::find(&all, "latest~1").unwrap(), first.path);
    assert_eq!(runs::find(&all, "sums").unwrap(), second.path);
    assert_eq!(runs::find(&all, "sums~1").unwrap(), first.path);
    let error = runs::find(&all, "latest~2").unwrap_err().to_string();
    assert_eq!(error, "`latest~2` does not exist: there are only 2 runs of `latest`");
    assert!(!runs::is_alive(&second.path));
}

#[test]
fn events_tell_the_run_in_lines_of_json() {
    let bench = Bench::new();
    let (report, _) = bench.run(&chain(1));
    let text = fs::read_to_string(report.path.join("events.jsonl")).unwrap();
    let events: Vec<serde_json::Value> = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let names: Vec<_> = events.iter().map(|event| event["event"].as_str().unwrap()).collect();
    assert_eq!(names[..4], ["run_started", "node_started", "figure", "node_finished"]);
    assert_eq!(events[0]["pipeline"], "sums");
    assert_eq!(events[1]["recording"], "live/a.mcap");
    assert_eq!(events[3]["recording"], "a.mcap");
    assert_eq!(events.last().unwrap()["executed"], 3);
    assert!(report.path.join("a.mcap").exists());
}

#[test]
fn links_that_cannot_be_made_are_one_warning_and_recordings_are_still_named() {
    let bench = Bench::new();
    let block =
        |name: &str| json!({"behaviour": format!("mkdir:{}", bench.runs().join("latest").join(name).display())});
    let graph = graph(&[("a", block("b.mcap"), &[]), ("b", block("c.mcap"), &["a"]), ("c", json!({}), &["b"])]);
    let (report, ear) = bench.run(&graph);
    assert_eq!((report.state, ear.warnings().len()), (RunState::Finished, 1), "{:?}", ear.warnings());
    assert!(ear.warnings()[0].starts_with("cannot link "), "{:?}", ear.warnings());
    let text = fs::read_to_string(report.path.join("events.jsonl")).unwrap();
    let events = text.lines().map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap());
    let recordings: Vec<_> = events.filter(|event| event["event"] == "node_finished").collect();
    for event in &recordings {
        assert!(report.path.join(event["recording"].as_str().unwrap()).is_file(), "{event}");
    }
    assert_eq!(recordings.len(), 3);
}
