//! The stages on tasks whose observation is two frames, and what `generate_data` and `evaluate` do beside the usual.

use crate::support::stages;
use carl_pipe::{
    artifact::{Artifact as _, Collected, Evaluation, Files, TrainedModel, Transitions},
    env::Task,
    stage::{self, Preset, PresetOf},
};
use serde_json::{Value, json};

fn task(env: &str) -> Task {
    serde_json::from_value(json!({ "env": env })).expect("a task")
}

fn run(env: &str, kind: &str, given: Value, inputs: &stages::Inputs<'_>) -> Files {
    stages::run_for(&task(env), kind, given, inputs, stages::stream(kind), 2).expect("a stage that works")
}

fn data(env: &str, given: Value) -> Transitions {
    Transitions::load(&run(env, "generate_data", given, &[])).expect("transitions")
}

/// Observations as (older frame, newer frame), and the next ones.
fn frames(data: &Transitions) -> Vec<[&[u8]; 4]> {
    let pixels = data.pixels();
    let pairs = data.observations.chunks_exact(pixels).zip(data.next_observations.chunks_exact(pixels));
    pairs.map(|(x, next)| [&x[..pixels / 2], &x[pixels / 2..], &next[..pixels / 2], &next[pixels / 2..]]).collect()
}

#[test]
fn the_newer_frame_of_an_observation_is_the_older_one_of_the_next() {
    for (env, picture, action_dim) in
        [("swing_up", (96, 48), 1), ("cart_pole", (160, 80), 1), ("three_pole", (160, 80), 3)]
    {
        let data = data(env, json!({ "samples": 30 }));
        assert_eq!((data.picture, data.action_dim, data.len()), (picture, action_dim, 30), "{env}");
        let frames = frames(&data);
        assert!(frames.iter().all(|[_, newer, older, _]| newer == older), "{env}");
        // A true step lies between them.
        assert!(frames.iter().filter(|[older, newer, ..]| older != newer).count() > 20, "{env}");
        let (older, newer) = data.goals.split_at(data.pixels() / 2);
        assert!(older == newer, "the goal of {env} is at rest");
    }
}

#[test]
fn transitions_of_a_trajectory_follow_each_other() {
    for (env, trajectory) in [("planar", 5), ("swing_up", 4)] {
        let data = data(env, json!({ "samples": 12, "trajectory": trajectory }));
        let pixels = data.pixels();
        for i in 1..data.len() {
            let before = &data.next_observations[(i - 1) * pixels..i * pixels];
            let follows = data.observations[i * pixels..(i + 1) * pixels] == *before;
            assert_eq!(follows, i % trajectory != 0, "{env}, transition {i}");
        }
    }
}

#[test]
fn biased_sampling_shows_another_part_of_the_world() {
    // The agent of the planar task is in the lower right corner only outside of the preferred square.
    let corner = |data: &Transitions| {
        let lit = |picture: &&[u8]| (35..40).any(|row| picture[row * 40 + 35..row * 40 + 40].contains(&255));
        data.observations.chunks_exact(1600).filter(lit).count()
    };
    let sampled = |given: Value| corner(&data("planar", given));
    assert!(sampled(json!({ "samples": 600 })) > 5);
    assert_eq!(sampled(json!({ "samples": 600, "region": { "biased": { "preferred_share": 1.0 } } })), 0);
    // The preset takes each task's share from the paper.
    assert_ne!(
        data("swing_up", json!({ "samples": 20 })),
        data("swing_up", json!({ "samples": 20, "region": { "biased": {} } }))
    );
}

#[test]
fn a_pendulum_is_learned_collected_and_measured() {
    let [model, agent] = learned("swing_up");
    let learned: &stages::Inputs<'_> = &[("model", &[&model]), ("agent", &[&agent])];
    let collected =
        Transitions::load(&run("swing_up", "collect", json!({ "samples": 9 }), learned)).expect("transitions");
    let frames = frames(&collected);
    assert!(frames[0][0] == frames[0][1], "a start is at rest");
    assert!(frames.windows(2).all(|two| two[0][2..] == two[1][..2]), "steps follow each other");
    let evaluation =
        Evaluation::load(&run("swing_up", "evaluate", json!({ "episodes": 1 }), learned)).expect("results");
    assert_eq!((evaluation.horizon, evaluation.episodes[0].path.len()), (400, 402));
    run("swing_up", "export_latent_map", json!({}), &[("model", &[&model])]);
}

/// A model and an agent, trained for a moment.
fn learned(env: &str) -> [Files; 2] {
    let bootstrap = run(env, "generate_data", json!({ "samples": 16 }), &[]);
    let few = json!({ "epochs": 2, "warm_up": { "epochs": 1, "anchor_epochs": 0 }, "ramp": { "epochs": 1 } });
    let model = run(env, "train_lce", few, &[("transitions", &[&bootstrap])]);
    let learn: &stages::Inputs<'_> = &[("transitions", &[&bootstrap]), ("model", &[&model])];
    let agent = run(env, "train_sac", json!({ "steps": 2 }), learn);
    [model, agent]
}

#[test]
fn a_collection_goes_on_where_the_one_before_stopped() {
    for (env, horizon) in [("swing_up", 400), ("planar", 40)] {
        let [model, agent] = learned(env);
        let collect = |given: Value, last: &[&Files]| {
            run(env, "collect", given, &[("model", &[&model]), ("agent", &[&agent]), ("last", last)])
        };
        let first = collect(json!({ "samples": 30, "continue": true }), &[]);
        let second = collect(json!({ "samples": 30, "continue": true }), &[&first]);
        let [one, two] = [&first, &second].map(|files| Collected::load(files).expect("a collection"));
        let pixels = one.transitions.pixels();
        let end = &one.transitions.next_observations[29 * pixels..];
        assert!(end == &two.transitions.observations[..pixels], "{env}: both frames go on");
        assert_eq!(one.transitions.goal_index[29], two.transitions.goal_index[0]);
        let steps = [one, two].map(|collected| collected.unfinished.expect("an episode that is left").steps);
        assert_eq!(steps, [30, if horizon > 60 { 60 } else { 60 - horizon }], "{env}");
        // A full episode leaves nothing to go on with, and without the option nothing is kept or used.
        let full = collect(json!({ "samples": horizon, "continue": true }), &[]);
        assert_eq!(Collected::load(&full).expect("a collection").unfinished, None);
        let fresh = collect(json!({ "samples": 30 }), &[]);
        assert_eq!((fresh.len(), &fresh), (1, &collect(json!({ "samples": 30 }), &[&first])));
    }
}

#[test]
fn an_episode_may_start_as_another_protocol_says() {
    let measure = |env: &str, start: &str| {
        let given = json!({ "controller": "oracle", "episodes": 10, "start": start });
        let files = run(env, "evaluate", given, &[]);
        let told: Value = serde_json::from_slice(&files.bytes("evaluation.json").expect("a file")).expect("JSON");
        assert_eq!(told.get("start").and_then(Value::as_str), (start != "usual").then_some(start));
        Evaluation::load(&files).expect("results")
    };
    let starts = |evaluation: &Evaluation| evaluation.episodes.iter().map(|e| e.path[0][0]).collect::<Vec<_>>();
    let narrow = measure("cart_pole", "narrow");
    assert!(starts(&narrow).iter().all(|angle| angle.abs() <= std::f64::consts::PI / 10.0));
    assert!(starts(&measure("cart_pole", "usual")).iter().any(|angle| angle.abs() > std::f64::consts::PI / 10.0));
    assert_eq!((narrow.percent_goal, narrow.share_of_ceiling), (100.0, Some(100.0)));
    let hanging = measure("swing_up", "paper");
    assert_eq!(starts(&hanging), [std::f64::consts::PI; 10]);
    assert!((hanging.share_of_ceiling.expect("a ceiling") - 100.0).abs() < 0.5, "{:?}", hanging.percent_goal);
    assert_eq!(measure("planar", "paper").episodes, measure("planar", "usual").episodes);
}

#[test]
fn a_drift_goes_along_with_a_warm_start() {
    let bootstrap = run("swing_up", "generate_data", json!({ "samples": 16 }), &[]);
    let train = |given: Value, start: &[&Files]| {
        let files = run("swing_up", "train_lce", given, &[("transitions", &[&bootstrap]), ("warm_start", start)]);
        let trained = TrainedModel::load(&files).expect("a model");
        assert_eq!(trained.adam.m.len(), trained.model.arena.len());
        let (name, layer) = trained.model.nets.layout.layers.last().expect("layers");
        let drift = (name == "drift").then(|| trained.model.arena[layer.at..layer.at + layer.len()].to_vec());
        (files, drift)
    };
    let few = json!({ "epochs": 2, "warm_up": { "epochs": 1, "anchor_epochs": 0 }, "ramp": { "epochs": 1 } });
    let (first, drift) = train(few, &[]);
    let drift = drift.expect("the preset has a drift");
    assert!(drift.iter().all(|&w| w != 0.0), "it was learned");
    let slow = json!({ "epochs": 1, "learning_rate": 1e-9 });
    assert!(train(slow, &[&first]).1.expect("a drift").iter().zip(&drift).all(|(new, old)| (new - old).abs() < 1e-6));
    let (without, dropped) = train(json!({ "epochs": 1, "passive_dynamics": "none" }), &[&first]);
    assert!(dropped.is_none());
    assert!(train(json!({ "epochs": 1 }), &[&without]).1.is_some());
}

#[test]
fn a_file_may_give_a_part_of_the_warm_up() {
    let given = json!({ "warm_up": { "loss": { "scale": 3 } } });
    let params = (stage::kind("train_lce").expect("a kind").canonical)(&given).expect("the preset gives the rest");
    assert_eq!(params["warm_up"]["loss"]["scale"], 3.0);
}

#[test]
fn an_oracle_is_measured_without_model_and_agent() {
    let given = json!({ "controller": "oracle", "episodes": 2 });
    let files = run("swing_up", "evaluate", given, &[]);
    let evaluation = Evaluation::load(&files).expect("results");
    assert!((evaluation.percent_goal - 98.5).abs() < 0.01, "{}", evaluation.percent_goal);
    assert_eq!(evaluation.policy_alone, evaluation.percent_goal);
    assert!((evaluation.share_of_ceiling.expect("a ceiling") - 100.0).abs() < 0.01);
    let told: Value = serde_json::from_slice(&files.bytes("evaluation.json").expect("a file")).expect("JSON");
    assert_eq!(told["controller"], "oracle");
}

#[test]
fn an_agent_is_not_measured_without_model_and_agent() {
    let failed = stages::run_for(&task("planar"), "evaluate", json!({}), &[], stages::stream("evaluate"), 1);
    assert_eq!(failed.unwrap_err().to_string(), "an agent needs the inputs `model` and `agent`");
}

#[test]
fn ilqr_is_not_measured_without_model_and_settings() {
    let given = json!({ "controller": "ilqr" });
    let failed = stages::run_for(&task("planar"), "evaluate", given, &[], stages::stream("evaluate"), 1);
    assert_eq!(failed.unwrap_err().to_string(), "iLQR needs the inputs `model` and `ilqr`");
}

#[test]
fn the_costs_of_ilqr_are_those_of_the_task_and_the_preset() {
    let settings = |env: &str, preset: Preset| {
        let (task, given) = (task(env), serde_json::Map::new());
        let params =
            (stage::kind("control_ilqr").expect("a kind").preset)(&PresetOf { preset, task: &task, given: &given });
        ["state_cost", "action_cost", "plan_length"].map(|name| params[name].as_f64().expect("a number"))
    };
    assert_eq!(settings("planar", Preset::Recipe), [10.0, 1.0, 10.0]);
    assert_eq!(settings("planar", Preset::Paper), [10.0, 9.0, 10.0], "an action moves by up to 3");
    assert_eq!(settings("swing_up", Preset::Recipe), [50.0, 1.0, 10.0]);
    assert_eq!(settings("cart_pole", Preset::Paper), [100.0, 100.0, 5.0]);
    assert_eq!(settings("three_pole", Preset::Paper), [50.0, 1.0, 20.0]);
}

#[test]
fn convolutional_tasks_are_learned_and_collected() {
    for env in ["cart_pole", "three_pole"] {
        let bootstrap = run(env, "generate_data", json!({ "samples": 4 }), &[]);
        let few = json!({ "epochs": 3, "warm_up": { "epochs": 2, "anchor_epochs": 1 }, "ramp": { "epochs": 1 } });
        let model = run(env, "train_lce", few, &[("transitions", &[&bootstrap])]);
        let learn: &stages::Inputs<'_> = &[("transitions", &[&bootstrap]), ("model", &[&model])];
        let agent = run(env, "train_sac", json!({ "steps": 2 }), learn);
        let learned: &stages::Inputs<'_> = &[("model", &[&model]), ("agent", &[&agent])];
        let collected = run(env, "collect", json!({ "samples": 3 }), learned);
        assert_eq!(Transitions::load(&collected).expect("transitions").len(), 3, "{env}");
    }
}
