//! The pipeline files that come with the program: every one unrolls and plans, every cell of the paper's table has one,
//! and the kinds of work that only some of them do run at tiny sizes.

use std::{collections::BTreeMap, fs, path::Path, process::Command};

use carl_pipe::{
    digest::Digest,
    pipeline::{self, Graph, Overrides, Source},
    run::{
        key,
        node::Work,
        plan::{Force, plan},
    },
    stage,
    store::LocalStore,
};

const TASKS: [&str; 4] = ["planar", "swing_up", "cart_pole", "three_pole"];

/// All files by name, with their text.
fn files() -> BTreeMap<String, String> {
    let entries = fs::read_dir("pipelines").unwrap().map(|entry| entry.unwrap().path());
    let stem = |path: &Path| path.file_stem().unwrap().to_string_lossy().into_owned();
    entries.map(|path| (stem(&path), fs::read_to_string(&path).unwrap())).collect()
}

fn graph(text: &str, set: &[&str]) -> Graph {
    graph_with(text, set, &[])
}

fn graph_with(text: &str, set: &[&str], sweep: &[&str]) -> Graph {
    let [set, sweep] = [set, sweep].map(|texts| texts.iter().map(|&text| text.to_owned()).collect());
    let overrides = Overrides { set, sweep };
    let source = Source::new("pipelines/pipeline.toml", text);
    let read = |name: &str| {
        let path = format!("pipelines/{name}");
        fs::read(&path).map(|bytes| Source::new(path, bytes)).map_err(|error| error.to_string())
    };
    pipeline::load_with(&source, &overrides, stage::registry(), &read, &stage::NothingOutside)
        .unwrap_or_else(|mistakes| panic!("{mistakes:?}"))
}

#[test]
fn every_file_is_named_as_its_pipeline_and_plans() {
    let folder = tempfile::tempdir().unwrap();
    let store = LocalStore::open(folder.path()).unwrap();
    for (name, text) in files() {
        let graph = graph(&text, &[]);
        assert_eq!(graph.name, name);
        assert!(text.contains(&format!("#   carl-pipe run pipelines/{name}.toml\n")), "{name} says how to run it");
        let plan = plan(&graph, &vec![true; graph.nodes.len()], &store, &Force::None).unwrap();
        assert!(plan.iter().all(Option::is_some), "{name}");
    }
}

/// A pipeline file may be written in another way, but it asks for the same work: every node has the same parameters, task,
/// stream and inputs. Versions of kinds are left out, since they may rise. `UPDATE_SNAPSHOTS=1` writes the digests anew. Do so
/// only where results change on purpose.
#[test]
fn every_file_asks_for_the_same_work_as_before() {
    let mut lines = String::new();
    for (name, text) in files() {
        let graph = graph(&text, &[]);
        let names = |sources: &[usize]| sources.iter().map(|id| graph.nodes[*id].name.clone()).collect::<Vec<_>>();
        let work: BTreeMap<&str, serde_json::Value> = graph
            .nodes
            .iter()
            .map(|node| {
                // As in a key, a port without inputs is left out, so that a kind may gain one.
                let used = node.inputs.iter().filter(|(_, sources)| !sources.is_empty());
                let inputs: BTreeMap<&str, Vec<String>> =
                    used.map(|(port, sources)| (port.name, names(sources))).collect();
                let mut key = key::without_inputs(&Work::of(node));
                key["version"] = serde_json::Value::Null;
                (&*node.name, serde_json::json!({ "key": key, "inputs": inputs }))
            })
            .collect();
        let digest = Digest::of_json(&serde_json::json!(work));
        lines += &format!("{name}: {} nodes, {digest}\n", graph.nodes.len());
    }
    let path = "tests/it/pipeline/shipped_keys.txt";
    if std::env::var_os("UPDATE_SNAPSHOTS").is_some() {
        fs::write(path, &lines).unwrap();
    }
    assert_eq!(lines, fs::read_to_string(path).unwrap_or_default());
}

/// The other commands that headers name.
#[test]
fn every_switch_that_a_header_names_can_be_set() {
    for (name, text) in files() {
        for line in text.lines().filter_map(|line| line.strip_prefix("#   carl-pipe run ")) {
            let words: Vec<&str> = line.split('#').next().unwrap().split_whitespace().collect();
            assert_eq!(words[0], format!("pipelines/{name}.toml"));
            let after =
                |flag: &str| -> Vec<&str> { words.windows(2).filter(|two| two[0] == flag).map(|two| two[1]).collect() };
            graph_with(&text, &after("-S"), &after("--sweep"));
        }
    }
}

#[test]
fn every_cell_of_the_papers_table_has_a_file_with_the_papers_number_of_samples() {
    let samples = [
        ("pcc", [5000, 5000, 10000, 4096]),
        ("offline", [5000, 5000, 10000, 4096]),
        ("online", [3072, 1408, 5120, 2944]),
        ("value_guided", [3200, 1408, 5120, 2816]),
    ];
    let files = files();
    for (algorithm, samples) in samples {
        for (task, samples) in TASKS.into_iter().zip(samples) {
            let name = format!("{task}_{algorithm}");
            let graph = graph(files.get(&name).unwrap_or_else(|| panic!("no {name}.toml")), &[]);
            let makes_data = |kind: &str| ["generate_data", "collect"].contains(&kind);
            let made = graph.nodes.iter().filter(|node| makes_data(node.kind.name));
            assert_eq!(made.map(|node| node.params["samples"].as_u64().unwrap()).sum::<u64>(), samples, "{name}");
            assert!(graph.nodes.iter().all(|node| node.task.name() == task), "{name}");
            let models = || graph.nodes.iter().filter(|node| node.kind.name == "train_lce");
            let objective = match algorithm {
                "pcc" | "value_guided" => algorithm,
                _ => "carl",
            };
            let is_chosen = |chosen: &serde_json::Value| chosen == objective || chosen.get(objective).is_some();
            assert!(models().all(|node| is_chosen(&node.params["objective"])), "{name}");
        }
    }
}

/// The samples of the model, and those of the control.
#[test]
fn every_solar_file_has_the_papers_number_of_samples() {
    let files = files();
    for (name, model, control) in [
        ("planar_solar", 5000, 16000),
        ("swing_up_solar", 5200, 40000),
        ("cart_pole_solar", 5000, 40000),
        ("three_pole_solar", 2000, 20000),
        ("planar_solar_fixed", 5000, 40000),
        ("swing_up_solar_fixed", 20000, 40000),
        ("cart_pole_solar_fixed", 10000, 40000),
    ] {
        let graph = graph(&files[name], &[]);
        let of = |kind: &str| graph.nodes.iter().find(|node| node.kind.name == kind).unwrap();
        let number = |kind: &str, parameter: &str| of(kind).params[parameter].as_u64().unwrap();
        assert_eq!(number("generate_trajectories", "samples"), model, "{name}");
        let rollouts = number("control_solar", "rollouts") * number("control_solar", "iterations");
        assert_eq!(rollouts * of("control_solar").task.spec().horizon as u64, control, "{name}");
    }
}

/// The appendix: lambda_p, lambda_c and tau.
#[test]
fn value_guided_files_have_the_papers_weights() {
    let files = files();
    for (task, prediction, consistency, inverse) in [
        ("planar", 2.0, 11.0, 30.0),
        ("swing_up", 1.0, 7.0, 60.0),
        ("cart_pole", 1.0, 7.0, 40.0),
        ("three_pole", 2.0, 11.0, 60.0),
    ] {
        let graph = graph(&files[&format!("{task}_value_guided")], &["preset=paper"]);
        let model = graph.nodes.iter().find(|node| node.name == "represent@1").unwrap();
        let (lambda, guidance) = (&model.params["lambda"], &model.params["objective"]["value_guided"]);
        let collect = graph.nodes.iter().find(|node| node.name == "collect@1").unwrap();
        // The paper trains once, and follows its policy throughout.
        assert_eq!((&model.params["restarts"], &collect.params["explore"]), (&0.into(), &0.0.into()), "{task}");
        assert_eq!(
            (&lambda["prediction"], &lambda["consistency"]),
            (&prediction.into(), &consistency.into()),
            "{task}"
        );
        assert_eq!(
            (&guidance["temperature"], &guidance["normalize"]),
            (&(1.0 / inverse).into(), &false.into()),
            "{task}"
        );
    }
}

/// The configuration of its authors' public code.
#[test]
fn pc3s_files_have_its_authors_weights_and_batches() {
    let files = files();
    for task in ["planar", "swing_up"] {
        let represent = |name: &str| {
            let graph = graph(&files[name], &[]);
            graph.nodes.iter().find(|node| node.kind.name == "train_lce").unwrap().params.clone()
        };
        let [letter, recipe] = [format!("{task}_pc3_paper"), format!("{task}_pc3")].map(|name| represent(&name));
        for params in [&letter, &recipe] {
            let pc3 = serde_json::json!({ "nce": 1.0, "center": 0.1, "sigma": 0.1, "batch": 256 });
            assert_eq!(params["objective"]["pc3"], pc3, "{task}");
            let lambda = &params["lambda"];
            assert_eq!((&lambda["consistency"], &lambda["curvature"]), (&1.0.into(), &7.0.into()), "{task}");
            assert_eq!((&params["learning_rate"], &params["weight_decay"]), (&5e-4.into(), &1e-3.into()), "{task}");
        }
        let of_ours = |params: &serde_json::Value| {
            (params["warm_up"]["epochs"].as_u64().unwrap(), params["lambda"]["anchor"].as_f64().unwrap())
        };
        assert_eq!((of_ours(&letter), &letter["epochs"]), ((0, 0.0), &2000.into()), "{task}");
        assert!(of_ours(&recipe).0 > 0 && of_ours(&recipe).1 > 0.0, "{task}");
    }
}

#[test]
fn both_controllers_share_the_maps_of_the_files_that_compare_them() {
    let files = files();
    let both = graph(&files["planar_controllers"], &[]);
    for (name, shared) in [("planar_pcc", ["represent", "evaluate"]), ("planar_offline", ["represent", "control"])] {
        for node in graph(&files[name], &[]).nodes.iter().filter(|node| shared.contains(&&*node.stage)) {
            let is_same = |other: &&pipeline::Node| {
                (other.kind.name, &other.params, &other.task, &other.stream)
                    == (node.kind.name, &node.params, &node.task, &node.stream)
            };
            assert!(both.nodes.iter().find(is_same).is_some(), "{name}: {}", node.name);
        }
    }
}

/// Runs the real program on a pipeline at tiny sizes, and returns the manifest of the run.
fn run(words: &str) -> serde_json::Value {
    let folder = tempfile::tempdir().unwrap();
    let ended = Command::new(env!("CARGO_BIN_EXE_carl-pipe"))
        .args(format!("run pipelines/{words} -q").split_whitespace())
        .arg("--artifacts")
        .arg(folder.path().join("store"))
        .output()
        .unwrap();
    assert_eq!(ended.status.code(), Some(0), "{words}: {}", String::from_utf8_lossy(&ended.stderr));
    let manifest = fs::read_to_string(folder.path().join("store/runs/latest/manifest.json")).unwrap();
    serde_json::from_str(&manifest).unwrap()
}

const TINY_ROUNDS: &str = "-S rounds=2 -S bootstrap.samples=40 -S collect.samples=12 -S represent.epochs=1 \
    -S represent.first.epochs=3 -S represent.warm_up.epochs=1 -S represent.warm_up.anchor_epochs=0 -S represent.ramp.epochs=1 \
    -S control.steps=2 -S control.first.steps=3 -S distill.steps=2 -S evaluate.episodes=1";

const TINY_FIT: &str = "-S bootstrap.samples=40 -S represent.epochs=3 -S represent.warm_up.epochs=1 \
    -S represent.warm_up.anchor_epochs=0 -S represent.ramp.epochs=1";

#[test]
fn value_guided_carl_runs() {
    let manifest = run(&format!("planar_value_guided.toml {TINY_ROUNDS}"));
    let read = |name: &str| serde_json::json!(fs::read_to_string(name).unwrap());
    assert_eq!(manifest["text"], read("pipelines/planar_value_guided.toml"));
    let base = &manifest["members"][0]["base"];
    assert_eq!(
        (&base["file"], &base["text"]),
        (&"pipelines/planar_online.toml".into(), &read("pipelines/planar_online.toml"))
    );
    let goes_on = "-S collect.inputs.last=collect@prev -S collect.continue=true";
    run(&format!("swing_up_value_guided.toml {TINY_ROUNDS} {goes_on} -S bootstrap.region=biased"));
}

#[test]
fn both_controllers_run_on_both_maps() {
    let few = "-S sac.steps=2 -S evaluate_sac.episodes=1 -S evaluate_ilqr.episodes=1";
    run(&format!("planar_controllers.toml {TINY_FIT} {few}"));
}
