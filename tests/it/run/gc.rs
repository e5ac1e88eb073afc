//! Cleaning: what is kept stays whole, whatever state the folders of the runs are in.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::{Path, PathBuf},
    thread,
    time::Duration,
};

use crate::support::run::{Bench, chain, graph};
use carl_pipe::{
    digest::Digest,
    pipeline::Graph,
    run::{
        events::NodeState::Cached,
        execute::{Options, Report},
        gc::{self, Limits, Plan, Policy},
        manifest::{Manifest, Unreadable},
        marks::Marks,
        runs,
    },
    store::{Error, LocalStore, Lookup, ResultStore as _},
};
use rand::{RngExt as _, SeedableRng as _, rngs::ChaCha12Rng};
use serde_json::{Value, json};

const ID: &str = "20261122-074808-704-6c0d";

fn keep(keep: usize) -> Policy {
    Policy::Limits(Limits { keep, older_than_secs: None, max_bytes: None })
}

fn drop_run(run: &str) -> Policy {
    Policy::Drop(BTreeSet::from([run.to_owned()]))
}

/// What a cleaning would do.
fn plan(bench: &Bench, policy: &Policy) -> Plan {
    gc::plan(&bench.store, &bench.runs(), policy).unwrap()
}

/// Opens a store that this test has just let go. A program that another test starts holds the lock, too, until it becomes
/// that program.
fn alone(root: &Path) -> LocalStore {
    for _ in 0..1000 {
        match LocalStore::open_alone(root) {
            Err(Error::Busy(_)) => thread::sleep(Duration::from_millis(10)),
            opened => return opened.unwrap(),
        }
    }
    panic!("somebody holds {}", root.display());
}

/// Cleans, and opens the store again.
fn clean(bench: Bench, policy: &Policy) -> (Bench, Plan) {
    let (root, runs) = (bench.store.root().to_owned(), bench.runs());
    let Bench { folder, store } = bench;
    drop(store);
    let alone = alone(&root);
    let plan = gc::plan(&alone, &runs, policy).unwrap();
    gc::remove(&alone, &runs, &plan).unwrap();
    drop(alone);
    (Bench { store: LocalStore::open(&root).unwrap(), folder }, plan)
}

fn removed(plan: &Plan) -> Vec<&str> {
    plan.removed.iter().map(|run| run.run.as_str()).collect()
}

fn listed(bench: &Bench) -> Vec<String> {
    runs::list(&bench.runs()).unwrap().into_iter().map(|run| run.id).collect()
}

/// A graph as another pipeline has it.
fn named(name: &str, mut graph: Graph) -> Graph {
    name.clone_into(&mut graph.name);
    name.clone_into(&mut graph.members[0].pipeline);
    graph
}

/// `a -> b -> c`, of which `c` fails.
fn failing(plus: i64) -> Graph {
    let broken = json!({"behaviour": "fail:broken"});
    graph(&[("a", json!({"plus": plus}), &[]), ("b", json!({"plus": 10}), &["a"]), ("c", broken, &["b"])])
}

/// The keys of what a run made or used.
fn results(report: &Report) -> Vec<Digest> {
    let done = report.manifest.nodes.iter().filter(|node| node.outcome.output.is_some());
    done.filter_map(|node| node.outcome.key).collect()
}

fn is_served(bench: &Bench, key: Digest) -> bool {
    matches!(bench.store.find(key).unwrap(), Lookup::Hit(_))
}

/// Changes a manifest as a carl-pipe would have written it before manifests had a digest.
fn rewrite(run_dir: &Path, change: impl FnOnce(&mut Value)) {
    let path = run_dir.join("manifest.json");
    let mut json: Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    json.as_object_mut().unwrap().remove("check");
    json["format"] = json!(1);
    change(&mut json);
    fs::write(path, serde_json::to_vec_pretty(&json).unwrap()).unwrap();
}

fn flip(path: &Path, bit: usize) {
    let mut bytes = fs::read(path).unwrap();
    let at = bit / 8 % bytes.len();
    bytes[at] ^= 1 << (bit % 8);
    fs::write(path, bytes).unwrap();
}

/// Removes the files and links of a run.
fn lose_files(run_dir: &Path) {
    for path in fs::read_dir(run_dir).unwrap().map(|item| item.unwrap().path()).filter(|path| !path.is_dir()) {
        fs::remove_file(path).unwrap();
    }
}

#[test]
fn a_cleaning_keeps_what_kept_runs_name() {
    let bench = Bench::new();
    let (first, _) = bench.run(&chain(1));
    bench.run(&chain(2));
    assert!(LocalStore::open_alone(bench.store.root()).unwrap_err().to_string().contains("is in use"));
    let counted = plan(&bench, &keep(1));
    let (bench, cleaned) = clean(bench, &keep(1));
    assert_eq!(counted, cleaned);
    assert_eq!((removed(&cleaned), cleaned.entries, cleaned.objects), (vec![first.run.as_str()], 3, 6));
    assert_eq!(bench.run(&chain(2)).0.count(Cached), 3);
    assert_eq!(bench.run(&chain(1)).1.ran(), ["a", "b", "c"]);
}

#[test]
fn runs_that_only_used_results_push_nothing_out() {
    let bench = Bench::new();
    let (made, _) = bench.run(&chain(1));
    let (other, _) = bench.run(&chain(2));
    let used: Vec<String> = (0..12).map(|_| bench.run(&chain(2)).0.run).collect();
    let part = graph(&[("a", json!({"plus": 1}), &[])]);
    let parts: Vec<String> = (0..3).map(|_| bench.run(&part).0.run).collect();
    let (bench, plan) = clean(bench, &keep(2));
    assert_eq!(plan.entries, 0);
    // The runs that made results stay, and the newest that used them.
    let mut kept = [made.run, other.run, used[11].clone(), parts[2].clone()].map(|run| run.to_owned());
    kept.reverse();
    assert_eq!(listed(&bench), kept);
    assert_eq!(bench.run(&chain(1)).0.count(Cached), 3);
}

#[test]
fn the_order_of_runs_trusts_no_clock() {
    let bench = Bench::new();
    let reports: Vec<Report> = (1..=3).map(|plus| bench.run(&chain(plus)).0).collect();
    // The clock stood in the future first, and in the past last.
    let ids = ["20990101-000000-000-0001", "20261122-074808-704-0002", "19990101-000000-000-0003"];
    for (report, id) in reports.iter().zip(ids) {
        fs::rename(&report.path, bench.runs().join(id)).unwrap();
    }
    assert_eq!(listed(&bench), [ids[2], ids[1], ids[0]]);
    assert_eq!(runs::find(&bench.runs(), "latest~1").unwrap(), bench.runs().join(ids[1]));
    let (bench, plan) = clean(bench, &keep(1));
    assert_eq!(removed(&plan), [ids[1], ids[0]]);
    assert!(results(&reports[2]).into_iter().all(|key| is_served(&bench, key)));
    let (next, _) = bench.run(&chain(4));
    assert_eq!(Manifest::read(&next.path).unwrap().number, Some(4));
    assert_eq!(runs::find(&bench.runs(), "latest").unwrap(), next.path);
}

#[test]
fn runs_without_a_number_come_before_all_others() {
    let bench = Bench::new();
    let old = bench.run(&chain(1)).0;
    rewrite(&old.path, |json| _ = json.as_object_mut().unwrap().remove("number"));
    fs::remove_file(old.path.join("events.jsonl")).unwrap();
    fs::rename(&old.path, bench.runs().join("20990101-000000-000-0001")).unwrap();
    let new = bench.run(&chain(2)).0;
    assert_eq!(listed(&bench), [new.run.as_str(), "20990101-000000-000-0001"]);
    assert!(Manifest::read(&bench.runs().join("20990101-000000-000-0001")).is_ok());
}

#[test]
fn foreign_folders_are_neither_counted_nor_removed() {
    let bench = Bench::new();
    let mut foreign = Vec::new();
    for (folder, file) in [("backup", "manifest.json"), ("20261122", "x"), (ID, "notes.txt"), ("~", "alive")] {
        let folder = bench.runs().join(folder);
        fs::create_dir_all(&folder).unwrap();
        fs::write(folder.join(file), "mine").unwrap();
        foreign.push(folder.join(file));
    }
    let empty = bench.runs().join("20261122-074808-704-6c0e");
    fs::create_dir(&empty).unwrap();
    fs::write(bench.runs().join("README"), "mine").unwrap();
    let kept = bench.run(&chain(1)).0;
    let (bench, plan) = clean(bench, &keep(1));
    assert!(plan.is_empty(), "{plan:?}");
    assert_eq!(listed(&bench), [kept.run]);
    assert!(foreign.iter().all(|file| file.exists()) && empty.exists() && bench.runs().join("README").exists());
}

#[test]
fn a_flipped_bit_in_the_numbers_changes_no_order() {
    let bench = Bench::new();
    let runs: Vec<String> = (1..=3).map(|plus| bench.run(&chain(plus)).0.run).collect();
    let numbers = bench.runs().join("numbers");
    let whole = fs::read(&numbers).unwrap();
    let newest_first: Vec<String> = runs.into_iter().rev().collect();
    for bit in 0..whole.len() * 8 {
        flip(&numbers, bit);
        assert_eq!(listed(&bench), newest_first, "bit {bit}");
        fs::write(&numbers, &whole).unwrap();
    }
}

#[test]
fn runs_of_one_pipeline_never_push_out_those_of_another() {
    let bench = Bench::new();
    let (slow, _) = bench.run(&named("slow", chain(1)));
    (10..15).for_each(|plus| _ = bench.run(&named("quick", chain(plus))));
    let (bench, plan) = clean(bench, &keep(1));
    assert_eq!((plan.removed.len(), plan.entries), (4, 12));
    assert!(results(&slow).into_iter().all(|key| is_served(&bench, key)));
}

#[test]
fn an_unfinished_run_stays_until_newer_ones_have_finished() {
    let bench = Bench::new();
    let (finished, _) = bench.run(&chain(1));
    let attempts: Vec<Report> = (2..4).map(|plus| bench.run(&failing(plus)).0).collect();
    assert!(plan(&bench, &keep(2)).removed.is_empty());
    let (bench, cleaned) = clean(bench, &keep(1));
    // The newest attempt and the newest run that finished.
    assert_eq!(removed(&cleaned), [attempts[0].run.as_str()]);
    assert!(results(&attempts[1]).into_iter().chain(results(&finished)).all(|key| is_served(&bench, key)));
    // A quick run of its first node ends well, and the attempt still has more than that.
    bench.run(&graph(&[("a", json!({"plus": 3}), &[])]));
    assert_eq!(plan(&bench, &keep(2)).entries, 0);
    let (later, _) = bench.run(&chain(5));
    assert_eq!(plan(&bench, &keep(3)).entries, 0);
    let (bench, cleaned) = clean(bench, &keep(1));
    assert_eq!((listed(&bench), cleaned.entries), (vec![later.run], 3 + 2));
}

#[test]
fn a_run_that_was_killed_keeps_what_it_made_and_used() {
    let bench = Bench::new();
    bench.run(&graph(&[("a", json!({"plus": 1}), &[])]));
    let (killed, _) = bench.run(&chain(1));
    // The manifest as it was when the first node started.
    rewrite(&killed.path, |json| {
        json["state"] = json!("running");
        for node in json["nodes"].as_array_mut().unwrap() {
            (node["state"], node["key"], node["output"]) = (json!("pending"), Value::Null, Value::Null);
        }
    });
    bench.run(&named("other", chain(7)));
    let (bench, plan) = clean(bench, &keep(1));
    assert_eq!(plan.entries, 0, "{plan:?}");
    assert!(results(&killed).into_iter().all(|key| is_served(&bench, key)));
}

#[test]
fn a_run_that_was_killed_before_its_first_node_is_a_run_without_results() {
    let bench = Bench::new();
    let (killed, _) = bench.run(&chain(1));
    let first_line = fs::read_to_string(killed.path.join("events.jsonl")).unwrap().lines().next().unwrap().to_owned();
    lose_files(&killed.path);
    fs::write(killed.path.join("events.jsonl"), first_line).unwrap();
    assert!(matches!(Manifest::read(&killed.path), Err(Unreadable::Missing(_))));
    // Its results have its name in their entries.
    assert!(plan(&bench, &keep(0)).removed.is_empty());
    let bench = clean(bench, &drop_run(&killed.run)).0;
    let empty = bench.runs().join(ID);
    fs::create_dir(&empty).unwrap();
    fs::write(
        empty.join("events.jsonl"),
        r#"{"event":"run_started","run":"x","number":9,"pipeline":"sums","seed":0,"nodes":3,"at":0.0}"#,
    )
    .unwrap();
    bench.run(&chain(2));
    assert_eq!(removed(&plan(&bench, &keep(1))), [ID]);
}

#[test]
fn one_flipped_bit_of_a_manifest_costs_no_result() {
    let bench = Bench::new();
    let (old, _) = bench.run(&chain(1));
    let (new, _) = bench.run(&chain(2));
    let mut random = ChaCha12Rng::seed_from_u64(1);
    for report in [&old, &new] {
        let path = report.path.join("manifest.json");
        let whole = fs::read(&path).unwrap();
        for _ in 0..150 {
            let bit = random.random_range(0..whole.len() * 8);
            flip(&path, bit);
            let error = Manifest::read(&report.path).unwrap_err();
            assert!(matches!(error, Unreadable::Damaged { .. }), "bit {bit}: {error}");
            let plan = plan(&bench, &keep(1));
            assert_eq!((plan.entries, plan.objects, removed(&plan)), (0, 0, Vec::new()), "bit {bit}");
            assert!(plan.kept.iter().any(|run| run.run == report.run && run.problem == Some("damaged manifest")));
            fs::write(&path, &whole).unwrap();
        }
    }
    assert_eq!(plan(&bench, &keep(1)).entries, 3);
}

#[test]
fn one_flipped_bit_of_an_older_manifest_without_a_digest_costs_no_result() {
    let bench = Bench::new();
    bench.run(&chain(1));
    let (new, _) = bench.run(&chain(2));
    rewrite(&new.path, |_| {});
    let path = new.path.join("manifest.json");
    let whole = fs::read(&path).unwrap();
    assert_eq!(plan(&bench, &keep(1)).entries, 3);
    let mut random = ChaCha12Rng::seed_from_u64(2);
    for _ in 0..300 {
        let bit = random.random_range(0..whole.len() * 8);
        flip(&path, bit);
        let entries = plan(&bench, &keep(1)).entries;
        assert!(entries == 3 || entries == 0, "bit {bit}: {entries} results would go");
        fs::write(&path, &whole).unwrap();
    }
}

#[test]
fn a_manifest_that_was_cut_blocks_nothing_and_costs_no_result() {
    let bench = Bench::new();
    let reports: Vec<Report> =
        (1..=4).map(|plus| bench.run(&named(&format!("p{}", plus % 2), chain(plus))).0).collect();
    let path = reports[0].path.join("manifest.json");
    let whole = fs::read(&path).unwrap();
    for end in [0, 1, 60, whole.len() / 2, whole.len() - 1] {
        fs::write(&path, &whole[..end]).unwrap();
        let plan = plan(&bench, &keep(1));
        assert_eq!(removed(&plan), [reports[1].run.as_str()], "cut at {end}");
        assert_eq!(plan.entries, 3);
    }
    let (bench, _) = clean(bench, &keep(1));
    assert!(results(&reports[0]).into_iter().all(|key| is_served(&bench, key)));
    let (bench, dropped) = clean(bench, &drop_run(&reports[0].run));
    assert_eq!((removed(&dropped), dropped.entries), (vec![reports[0].run.as_str()], 3));
    assert_eq!(listed(&bench), [reports[3].run.as_str(), reports[2].run.as_str()]);
}

#[test]
fn entries_tell_what_a_run_made_where_its_files_do_not() {
    let bench = Bench::new();
    let reports: Vec<Report> = (1..=3).map(|plus| bench.run(&chain(plus)).0).collect();
    lose_files(&reports[0].path);
    fs::write(reports[0].path.join("manifest.json"), "").unwrap();
    let (bench, plan) = clean(bench, &keep(1));
    assert_eq!((removed(&plan), plan.entries), (vec![reports[1].run.as_str()], 3));
    assert!(results(&reports[0]).into_iter().all(|key| is_served(&bench, key)));
}

#[test]
fn where_nothing_tells_what_a_run_names_every_result_stays() {
    let bench = Bench::new();
    bench.run(&chain(1));
    let (unknown, _) = bench.run(&chain(1));
    bench.run(&chain(2));
    bench.run(&chain(3));
    lose_files(&unknown.path);
    fs::write(unknown.path.join("manifest.json"), "").unwrap();
    let (bench, plan) = clean(bench, &keep(1));
    assert_eq!((plan.removed.len(), plan.entries), (2, 0));
    assert!(plan.kept.iter().any(|run| run.run == unknown.run && run.keeps_all));
    let (_, plan) = clean(bench, &drop_run(&unknown.run));
    assert_eq!(plan.entries, 6);
}

#[test]
fn pins_and_tags_keep_a_run() {
    let bench = Bench::new();
    let reports: Vec<Report> = (1..=4).map(|plus| bench.run(&chain(plus)).0).collect();
    Marks { pinned: true, ..Marks::default() }.write(&reports[0].path).unwrap();
    Marks { tags: vec!["best".to_owned()], ..Marks::default() }.write(&reports[1].path).unwrap();
    assert_eq!(removed(&plan(&bench, &keep(0))), [reports[2].run.as_str()]);
    assert_eq!(runs::find(&bench.runs(), "best").unwrap(), reports[1].path);
    // Marks that cannot be read may be a pin.
    let path = reports[0].path.join("marks.json");
    let whole = fs::read(&path).unwrap();
    for bit in 0..whole.len() * 8 {
        flip(&path, bit);
        assert_eq!(removed(&plan(&bench, &keep(0))), [reports[2].run.as_str()], "bit {bit}");
        fs::write(&path, &whole).unwrap();
    }
    fs::remove_file(path).unwrap();
    assert_eq!(removed(&plan(&bench, &keep(0))), [reports[2].run.as_str(), reports[0].run.as_str()]);
}

#[test]
fn a_limit_of_bytes_takes_the_oldest_first_and_never_the_newest_of_a_pipeline() {
    let bench = Bench::new();
    let big = |plus: i64| graph(&[("a", json!({"plus": plus, "ballast": 100_000}), &[])]);
    let reports: Vec<Report> =
        (1..=5).map(|plus| bench.run(&named(if plus == 1 { "p" } else { "q" }, big(plus))).0).collect();
    let limit = |bytes| Policy::Limits(Limits { keep: 10, older_than_secs: None, max_bytes: Some(bytes) });
    let all = plan(&bench, &keep(10)).kept_bytes;
    assert!(plan(&bench, &limit(all)).removed.is_empty());
    // The ballast of all is one object, since its bytes are the same, so a run is its folder and small files.
    let one = plan(&bench, &limit(all - 300));
    assert_eq!(removed(&one), [reports[1].run.as_str()]);
    assert!(one.kept_bytes <= all - 300);
    assert_eq!(removed(&plan(&bench, &limit(0))), [3, 2, 1].map(|at: usize| reports[at].run.as_str()));
}

#[test]
fn an_age_keeps_what_is_young_whatever_the_clock_said() {
    let bench = Bench::new();
    let reports: Vec<Report> = (1..=5).map(|plus| bench.run(&chain(plus)).0).collect();
    let at = ["2020-01-01T00:00:00Z", "2999-01-01T00:00:00Z", "2020-01-02T00:00:00Z", "yesterday"];
    for (report, started) in reports.iter().zip(at) {
        rewrite(&report.path, |json| json["started"] = json!(started));
    }
    let older = |secs| Policy::Limits(Limits { keep: 1, older_than_secs: Some(secs), max_bytes: None });
    // Only times that have been are known to be old.
    assert_eq!(removed(&plan(&bench, &older(86_400))), [2, 0].map(|at: usize| reports[at].run.as_str()));
    // A clock that stood in the past makes no run older than one before it.
    rewrite(&reports[0].path, |json| {
        json["started"] = serde_json::from_slice::<Value>(&fs::read(reports[4].path.join("manifest.json")).unwrap())
            .unwrap()["started"]
            .clone();
    });
    assert!(plan(&bench, &older(86_400)).removed.is_empty());
}

#[test]
fn a_cleaning_that_was_killed_is_completed_by_the_next() {
    let bench = Bench::new();
    let reports: Vec<Report> = (1..=3).map(|plus| bench.run(&chain(plus)).0).collect();
    // One run is renamed and half gone, a second is whole, and some of the results are gone.
    let gone = bench.runs().join(format!(".gone-{}", reports[0].run));
    fs::rename(&reports[0].path, &gone).unwrap();
    fs::remove_file(gone.join("manifest.json")).unwrap();
    fs::remove_file(bench.entry(&reports[1], "a")).unwrap();
    let (bench, plan) = clean(bench, &keep(1));
    assert_eq!((removed(&plan), plan.entries), (vec![reports[1].run.as_str()], 5));
    assert!(!gone.exists());
    let names: Vec<String> =
        fs::read_dir(bench.runs()).unwrap().map(|it| it.unwrap().file_name().into_string().unwrap()).collect();
    let left = ["latest", "numbers", &reports[2].run];
    assert_eq!(names.iter().map(String::as_str).collect::<BTreeSet<_>>(), BTreeSet::from(left));
    assert!(self::plan(&bench, &keep(1)).is_empty());
}

/// A store with runs in random states, and the keys of what each run made or used.
struct Wild {
    bench: Bench,
    results: BTreeMap<PathBuf, Vec<Digest>>,
}

impl Wild {
    fn new(random: &mut ChaCha12Rng) -> Self {
        let (bench, mut results) = (Bench::new(), BTreeMap::new());
        for at in 0..random.random_range(3..9_u32) {
            let plus = random.random_range(0..4_i64);
            let graph = match random.random_range(0..4) {
                0 => failing(plus),
                1 => graph(&[("a", json!({"plus": plus}), &[])]),
                _ => chain(plus),
            };
            let options = Options { jobs: 1, ..Options::default() };
            let (report, _) = bench.run_with(&named(["p", "q"][random.random_range(0..2)], graph), &options);
            // Clocks go wrong.
            let id = format!("{}-000000-000-{at:04x}", random.random_range(19_700_101..20_991_231_u32));
            let path = bench.runs().join(id);
            fs::rename(&report.path, &path).unwrap();
            results.insert(path, self::results(&report));
        }
        let wild = Self { bench, results };
        wild.results.keys().for_each(|path| wild.harm(path, random));
        wild
    }

    /// Does something to a run that may happen, or nothing.
    fn harm(&self, run_dir: &Path, random: &mut ChaCha12Rng) {
        let manifest = run_dir.join("manifest.json");
        let length = fs::read(&manifest).unwrap().len();
        match random.random_range(0..10) {
            0 => flip(&manifest, random.random_range(0..length * 8)),
            1 => fs::write(&manifest, &fs::read(&manifest).unwrap()[..random.random_range(0..length)]).unwrap(),
            2 => fs::remove_file(&manifest).unwrap(),
            3 => fs::write(run_dir.join("events.jsonl"), "").unwrap(),
            4 => Marks { pinned: true, ..Marks::default() }.write(run_dir).unwrap(),
            5 => rewrite(run_dir, |json| json["state"] = json!("running")),
            6 => {
                fs::create_dir(self.bench.runs().join(random.random_range(0..u64::MAX).to_string())).unwrap();
            }
            _ => {}
        }
    }
}

#[test]
fn every_result_that_a_kept_run_names_is_still_served() {
    let mut random = ChaCha12Rng::seed_from_u64(3);
    let mut gone = 0;
    for round in 0..25 {
        let Wild { bench, results } = Wild::new(&mut random);
        let policy = match random.random_range(0..4) {
            0 => Policy::Limits(Limits {
                keep: 2,
                older_than_secs: None,
                max_bytes: Some(random.random_range(0..60_000)),
            }),
            _ => keep(random.random_range(0..4)),
        };
        let latest = listed(&bench).swap_remove(0);
        let (bench, cleaned) = clean(bench, &policy);
        let left = listed(&bench);
        assert!(left.contains(&latest), "{round}: {cleaned:?}");
        assert_eq!(left, cleaned.kept.iter().map(|run| run.run.clone()).collect::<Vec<_>>());
        for (path, keys) in results.iter().filter(|(path, _)| path.exists()) {
            for &key in keys {
                assert!(is_served(&bench, key), "round {round}: {} lost {key}: {cleaned:?}", path.display());
            }
        }
        let again = plan(&bench, &policy);
        assert!(again.is_empty(), "round {round}: a second cleaning would remove more: {again:?}");
        gone += cleaned.removed.len();
    }
    assert!(gone > 25, "only {gone} runs were removed in all");
}
