//! Verifying and repairing: every damage is named, and what a run used is made again with the same bytes.

use std::{
    collections::BTreeSet,
    fs,
    path::{Path, PathBuf},
};

use crate::support::run::{Bench, Ear, chain, damage, graph, kind};
use carl_pipe::{
    run::{
        events::NodeState::Cached,
        execute::Options,
        manifest::Manifest,
        recordings::Recordings,
        repair::{Repaired, repair},
        verify::{Verified, run_folders, verify},
    },
    store::{Fault, ResultStore as _},
};
use rand::{RngExt as _, SeedableRng as _};
use serde_json::json;

fn verified(bench: &Bench) -> Verified {
    verify(&bench.store, &run_folders(&bench.runs()).unwrap(), true)
}

fn repaired(bench: &Bench, run_dir: &Path) -> Repaired {
    for problem in verified(bench).problems {
        bench.store.move_to_bad(&problem.path);
    }
    let manifest = Manifest::read(run_dir).unwrap();
    repair(&manifest, &bench.store, &bench.path("scratch"), &Options::default(), &kind, &()).unwrap()
}

/// Every object and every entry.
fn files(bench: &Bench) -> Vec<PathBuf> {
    let inventory = bench.store.inventory();
    let objects = inventory.objects.iter().map(|object| bench.store.path_of(*object).unwrap());
    objects.chain(inventory.keys.iter().map(|key| bench.store.path_of_entry(*key))).collect()
}

#[test]
fn what_was_just_made_is_whole() {
    let bench = Bench::new();
    bench.run(&chain(1));
    let found = verified(&bench);
    assert_eq!((found.runs, found.entries, found.objects, found.problems), (1, 3, 6, vec![]));
    let bytes: u64 = files(&bench)[..6].iter().map(|path| fs::metadata(path).unwrap().len()).sum();
    assert_eq!(found.bytes, bytes);
}

#[test]
fn any_damage_is_named_and_made_again_with_the_same_bytes() {
    let mut random = rand::rngs::ChaCha12Rng::seed_from_u64(3);
    for _ in 0..12 {
        let bench = Bench::new();
        let (report, _) = bench.run(&chain(1));
        let before: Vec<_> = files(&bench).iter().map(|path| fs::read(path).unwrap()).collect();
        let mut hurt = BTreeSet::new();
        for path in files(&bench) {
            match random.random_range(0..5) {
                0 => damage(&path),
                1 => fs::remove_file(&path).unwrap(),
                2 => fs::write(&path, "").unwrap(),
                _ => continue,
            }
            hurt.insert(path);
        }
        let found = verified(&bench);
        let named: BTreeSet<PathBuf> = found.problems.iter().map(|problem| problem.path.clone()).collect();
        // What hangs on a lost entry is known by its bytes alone, so a lost object without an entry is named by none.
        assert!(named.is_subset(&hurt), "{named:?} {hurt:?}");
        for lost in hurt.difference(&named) {
            assert!(!lost.exists() && lost.starts_with(bench.store.root().join("objects")), "{lost:?} is not named");
        }
        let used = found.problems.iter().filter(|problem| problem.is_used);
        assert!(used.clone().all(|it| it.node.is_some() && it.run.as_ref() == Some(&report.run)), "{found:?}");
        let done = repaired(&bench, &report.path);
        assert_eq!(done.left, []);
        assert_eq!(verified(&bench).problems, []);
        let (again, ear) = bench.run(&chain(1));
        assert_eq!((again.count(Cached), ear.warnings().len()), (3, 0));
        let objects = before.len() - 3;
        let after: Vec<_> = files(&bench)[..objects].iter().map(|path| fs::read(path).unwrap()).collect();
        assert_eq!(before[..objects], after, "outputs and recordings have the same bytes");
    }
}

#[test]
fn a_file_that_cannot_be_read_hides_no_other() {
    let bench = Bench::new();
    bench.run(&chain(1));
    let files = files(&bench);
    fs::remove_file(&files[0]).unwrap();
    fs::create_dir(&files[0]).unwrap();
    damage(&files[5]);
    let problems = verified(&bench).problems;
    assert_eq!(problems.iter().map(|it| &it.path).collect::<Vec<_>>(), [&files[0], &files[5]]);
    assert!(matches!(problems[0].fault, Fault::Unreadable(_)), "{problems:?}");
    assert_eq!(problems[1].fault, Fault::Damaged);
}

#[test]
fn a_recording_that_failed_in_passing_is_not_lost_for_good() {
    let bench = Bench::new();
    let block = format!("mkdir:{}", bench.runs().join("latest/live/b.mcap").display());
    let graph = graph(&[("a", json!({"behaviour": block}), &[]), ("b", json!({"plus": 2}), &["a"])]);
    let (report, ear) = bench.run(&graph);
    assert!(ear.warnings()[0].starts_with("cannot record to"), "{:?}", ear.warnings());
    let problems = verified(&bench).problems;
    assert_eq!((problems.len(), problems[0].what.as_str(), &problems[0].fault), (1, "recording", &Fault::Missing));
    assert_eq!(problems[0].node.as_deref(), Some("b"));
    let recording = || Recordings::of_run(&report.path).of_node("b");
    assert_eq!(recording(), None);
    let done = repaired_without_moving(&bench, &report.path);
    assert_eq!((done.made, done.left), (vec!["b".to_owned()], vec![]));
    // The old run leads to it, too.
    assert!(recording().is_some_and(|path| path.exists()));
    let (again, ear) = bench.run(&graph);
    assert_eq!((again.count(Cached), ear.warnings()), (2, vec![]));
    assert!(again.path.join("b.mcap").exists());
}

fn repaired_without_moving(bench: &Bench, run_dir: &Path) -> Repaired {
    let manifest = Manifest::read(run_dir).unwrap();
    repair(&manifest, &bench.store, &bench.path("scratch"), &Options::default(), &kind, &Ear::default()).unwrap()
}

#[test]
fn an_output_that_comes_out_otherwise_is_told() {
    let bench = Bench::new();
    let dice = bench.path("dice");
    fs::write(&dice, "3").unwrap();
    let throw = json!({"behaviour": format!("read:{}", dice.display())});
    let (report, _) = bench.run(&graph(&[("throw", throw, &[])]));
    fs::write(&dice, "5").unwrap();
    fs::remove_file(bench.object(&report, "throw")).unwrap();
    let done = repaired_without_moving(&bench, &report.path);
    assert_eq!((done.made.len(), done.left[0].0.as_str()), (0, "throw"));
    assert!(done.left[0].1.starts_with("its output came out otherwise: it was b3:"), "{done:?}");
    assert_eq!(verified(&bench).problems[0].what, "output");
}

#[test]
fn a_damaged_manifest_is_named_and_the_other_runs_are_verified() {
    let bench = Bench::new();
    let (first, _) = bench.run(&chain(1));
    let (second, _) = bench.run(&chain(2));
    fs::write(second.path.join("manifest.json"), "{").unwrap();
    fs::remove_file(bench.object(&first, "c")).unwrap();
    let problems = verified(&bench).problems;
    let told: Vec<_> = problems.iter().map(|it| (it.what.as_str(), it.run.as_deref().unwrap())).collect();
    assert_eq!(told, [("manifest", second.run.as_str()), ("number.txt", first.run.as_str())]);
}
