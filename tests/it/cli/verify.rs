//! `carl-pipe verify` and `run --repair`: what they say, and with which exit codes they end.

use std::fs;

use crate::support::{
    cli::{Toy, digests},
    run::damage,
};
use serde_json::json;

#[test]
fn damage_is_named_repaired_and_gone() {
    let toy = Toy::new();
    let first = toy.run("run toy.toml --json").json();
    let whole = toy.run("verify");
    assert_eq!(whole.code, Some(0), "{whole:?}");
    assert!(whole.out.starts_with("read 7 results, ") && whole.out.trim_end().ends_with(": all whole"), "{whole:?}");
    let latest = toy.path("artifacts/runs/latest");
    damage(&fs::canonicalize(latest.join("learn@1.mcap")).unwrap());
    fs::remove_file(fs::canonicalize(latest.join("evaluate@2.value.json")).unwrap()).unwrap();
    let found = toy.run("verify latest");
    assert_eq!(found.code, Some(5), "{found:?}");
    let run = first["run"].as_str().unwrap();
    for (problem, what) in [("damaged", "recording of learn@1"), ("missing", "value.json of evaluate@2")] {
        let line = found.out.lines().find(|line| line.starts_with(problem)).unwrap();
        assert!(line.contains(what) && line.contains(run) && line.contains("artifacts/objects/"), "{line}");
    }
    assert!(found.err.contains("help: `carl-pipe verify --repair` makes it again"), "{found:?}");
    let repaired = toy.run("verify --repair --json");
    assert_eq!(repaired.code, Some(0), "{repaired:?}");
    let json = repaired.json();
    assert_eq!(json["repaired"], json!({"made": ["learn@1", "evaluate@2"], "failed": [], "problems": []}));
    assert_eq!(toy.run("verify").code, Some(0));
    let again = toy.run("run toy.toml --json");
    assert_eq!((&again.json()["cached"], again.err.as_str()), (&json!(7), ""));
    assert_eq!(digests(&first), digests(&again.json()));
    // A repair is no run.
    assert_eq!(toy.run("log --json").out.lines().count(), 2);
    assert_eq!(fs::read_dir(toy.path("artifacts/tmp")).unwrap().count(), 0);
}

#[test]
fn a_run_with_repair_makes_lost_recordings_again() {
    let toy = Toy::new();
    toy.run("run toy.toml");
    fs::remove_file(fs::canonicalize(toy.path("artifacts/runs/latest/learn@1.mcap")).unwrap()).unwrap();
    let told = toy.run("run toy.toml -q");
    assert_eq!(told.code, Some(0));
    assert!(
        told.err.contains("warning: learn@1: its result is cached without a recording; `carl-pipe verify"),
        "{told:?}"
    );
    assert!(toy.run("run toy.toml --repair -n").out.contains("its recording is gone"));
    let repaired = toy.run("run toy.toml --repair --json");
    assert_eq!((&repaired.json()["executed"], repaired.err.as_str()), (&json!(1), ""), "{repaired:?}");
    assert_eq!(toy.run("verify").code, Some(0));
}

#[test]
fn what_no_run_uses_is_set_aside() {
    let toy = Toy::new();
    toy.run("run toy.toml");
    toy.run("run toy.toml -S data.plus=6");
    let runs = toy.path("artifacts/runs");
    let second = fs::read_link(runs.join("latest")).unwrap();
    let object = fs::canonicalize(runs.join("latest/evaluate@2.value.json")).unwrap();
    fs::remove_dir_all(runs.join(second)).unwrap();
    damage(&object);
    let found = toy.run("verify");
    assert_eq!(found.code, Some(5));
    assert!(found.out.contains("value.json of evaluate@2") && found.out.contains("used by none"), "{found:?}");
    let repaired = toy.run("verify --repair");
    assert_eq!(repaired.code, Some(0), "{repaired:?}");
    assert!(repaired.out.ends_with("made 0 nodes again: all whole\n"), "{repaired:?}");
}

#[test]
fn a_damaged_manifest_is_named_with_what_can_be_done() {
    let toy = Toy::new();
    let run = toy.run("run toy.toml --json").json()["run"].as_str().unwrap().to_owned();
    fs::write(toy.path("artifacts/runs/latest/manifest.json"), "{").unwrap();
    for words in ["verify", "verify --repair"] {
        let found = toy.run(words);
        assert_eq!(found.code, Some(5), "{found:?}");
        assert!(found.out.starts_with("damaged  manifest   run 20") && found.out.contains("1 problem"), "{found:?}");
        let told = format!(
            "the manifest of run {run} of `toy` cannot be made again; 7 of its results are left, and `carl-pipe run` of its \
             file takes them into a new run; `carl-pipe gc --drop {run}` removes the run"
        );
        assert!(found.err.contains(&told), "{found:?}");
        assert!(!found.err.contains("makes it again"), "{found:?}");
    }
}
