//! What failed map checks lead to: training starts again, and episodes explore.

use crate::support::stages;
use std::{collections::BTreeMap, sync::Mutex};

use carl_pipe::{
    artifact::{Artifact as _, Files, TrainedModel, Transitions},
    stage::Host,
};
use serde_json::{Value, json};

/// A host that remembers metrics, sentences and how many epochs there were.
#[derive(Default)]
struct Ear {
    metrics: Mutex<BTreeMap<String, f64>>,
    said: Mutex<Vec<String>>,
    epochs: Mutex<u64>,
}

impl Host for Ear {
    fn progress(&self, done: u64, total: u64, _: &str) {
        assert!(done <= total, "{done} of {total}");
        *self.epochs.lock().unwrap() = done;
    }
    fn metric(&self, name: &str, value: f64) {
        self.metrics.lock().unwrap().insert(name.to_owned(), value);
    }
    fn say(&self, text: &str) {
        self.said.lock().unwrap().push(text.to_owned());
    }
    fn stop_asked(&self) -> bool {
        false
    }
}

impl Ear {
    fn metric_of(&self, name: &str) -> f64 {
        self.metrics.lock().unwrap()[name]
    }

    fn epochs(&self) -> u64 {
        *self.epochs.lock().unwrap()
    }

    fn heard(&self, words: &str) -> bool {
        self.said.lock().unwrap().iter().any(|sentence| sentence.contains(words))
    }
}

fn train(given: Value, inputs: &stages::Inputs<'_>, threads: usize) -> (Files, Ear) {
    let ear = Ear::default();
    let stream = stages::stream("train_lce");
    let files = stages::run_heard(&stages::planar(), "train_lce", given, inputs, stream, threads, &ear);
    (files.expect("a model"), ear)
}

fn data() -> Files {
    stages::run("generate_data", json!({ "samples": 64 }), &[])
}

/// Two epochs: a map that is good for nothing.
fn hardly_trained(restarts: u64) -> Value {
    json!({ "epochs": 2, "warm_up": { "epochs": 1, "anchor_epochs": 0 }, "ramp": { "epochs": 1 }, "restarts": restarts })
}

#[test]
fn the_soundest_of_the_maps_stays() {
    let data = data();
    let runs: Vec<_> =
        (0..3).map(|restarts| train(hardly_trained(restarts), &[("transitions", &[&data])], 2)).collect();
    for (restarts, (_, ear)) in runs.iter().enumerate() {
        assert_eq!((ear.metric_of("restarts"), ear.epochs()), (restarts as f64, 2 + 2 * restarts as u64));
        assert_eq!(ear.heard("retraining from new weights"), restarts > 0);
    }
    for pair in runs.windows(2) {
        let [(before, spread_before), (after, spread_after)] =
            [&pair[0], &pair[1]].map(|(files, ear)| (files, ear.metric_of("code_spread")));
        assert!(spread_before <= spread_after && spread_after < 1.0, "{spread_before} {spread_after}");
        assert_eq!(before == after, spread_before == spread_after);
    }
}

#[test]
fn a_collapsed_map_of_the_round_before_is_given_up() {
    let data = data();
    let (bad, _) = train(hardly_trained(0), &[("transitions", &[&data])], 2);
    let inputs: &stages::Inputs<'_> = &[("transitions", &[&data]), ("warm_start", &[&bad])];
    let warm_up = json!({ "epochs": 1, "warm_up": { "epochs": 120, "anchor_epochs": 50 }, "ramp": { "epochs": 0 } });
    let given = |restarts: u64| {
        let mut given = warm_up.clone();
        given["restarts"] = json!(restarts);
        given
    };
    let (_, warm) = train(given(0), inputs, 2);
    let (files, ear) = train(given(1), inputs, 2);
    assert_eq!((ear.metric_of("restarts"), ear.epochs()), (1.0, 1 + 120 + 1));
    let spread = [&warm, &ear].map(|ear| ear.metric_of("code_spread"));
    assert!(spread[1] > 20.0 * spread[0], "{spread:?}");
    assert!(ear.heard("retraining from new weights") && !ear.heard("kept attempt"));
    let suspect = |files: &Files| TrainedModel::load(files).unwrap().suspect_goals;
    assert_eq!(suspect(&files).is_empty(), ear.metric_of("goal_rank") <= 0.995, "{:?}", suspect(&files));
    assert!(suspect(&bad).is_empty(), "no goal is suspect in the first round");
    let (again, _) = train(given(1), inputs, 1);
    assert!(files == again, "another number of threads, other bits");
}

#[test]
fn an_attempt_that_diverges_is_replaced_by_new_weights() {
    let data = data();
    let (start, _) = train(hardly_trained(0), &[("transitions", &[&data])], 2);
    // Finite weights whose losses overflow.
    let mut extreme = TrainedModel::load(&start).unwrap();
    extreme.model.arena.iter_mut().for_each(|weight| *weight *= 1e20);
    let extreme = extreme.save().unwrap();
    let inputs: &stages::Inputs<'_> = &[("transitions", &[&data]), ("warm_start", &[&extreme])];
    let few = |restarts: u64| json!({ "epochs": 1, "warm_up": { "epochs": 1, "anchor_epochs": 0 }, "ramp": { "epochs": 0 }, "restarts": restarts });
    let (_, ear) = train(few(1), inputs, 2);
    assert!(ear.heard("diverged in step 0: ") && ear.heard("; retraining from new weights (1 of 1)"));
    assert_eq!((ear.metric_of("restarts"), ear.epochs()), (1.0, 2));
    let alone = stages::run_for(&stages::planar(), "train_lce", few(0), inputs, stages::stream("train_lce"), 2);
    assert!(alone.unwrap_err().to_string().starts_with("diverged in step 0: "));
}

#[test]
fn a_map_of_an_earlier_attempt_stays_where_the_retraining_diverges() {
    let data = data();
    let (bad, _) = train(hardly_trained(0), &[("transitions", &[&data])], 2);
    let inputs: &stages::Inputs<'_> = &[("transitions", &[&data]), ("warm_start", &[&bad])];
    // The warm-up is part of the retraining alone.
    let given = |restarts: u64| {
        let warm_up = json!({ "epochs": 2, "anchor_epochs": 0, "learning_rate": 1e30 });
        json!({ "epochs": 1, "warm_up": warm_up, "restarts": restarts })
    };
    let (kept, ear) = train(given(1), inputs, 2);
    assert!(ear.heard("the map has collapsed") && ear.heard("diverged in step ") && ear.heard("kept attempt 1 of 2"));
    let model = |files: &Files| TrainedModel::load(files).unwrap().model;
    assert!(model(&kept) == model(&train(given(0), inputs, 2).0));
}

#[test]
fn episodes_to_a_suspect_goal_end_with_random_actions() {
    let data = data();
    let (model, _) = train(hardly_trained(0), &[("transitions", &[&data])], 2);
    let agent = stages::run("train_sac", json!({ "steps": 3 }), &[("transitions", &[&data]), ("model", &[&model])]);
    let doubting = |goals: &[usize]| {
        let model = TrainedModel { suspect_goals: goals.to_vec(), ..TrainedModel::load(&model).unwrap() };
        model.save().unwrap()
    };
    let transitions = |model: &Files, given: Value| {
        let files = stages::run("collect", given, &[("model", &[model]), ("agent", &[&agent])]);
        Transitions::load(&files).unwrap()
    };
    let all = doubting(&[0, 1, 2]);
    let collected =
        |model: &Files, explore: f64| transitions(model, json!({ "samples": 40, "explore": explore })).actions;
    let [trusting, half, none] = [(&model, 0.5), (&all, 0.5), (&all, 0.0)].map(|(m, e)| collected(m, e));
    let (policy, random) = half.split_at(20 * 2);
    assert_eq!(policy, &trusting[..40]);
    assert!(random.iter().zip(&trusting[40..]).all(|(a, b)| a != b));
    assert_eq!(none, trusting);
    // Of fewer samples than an episode has steps, half of the samples.
    let few = transitions(&all, json!({ "samples": 20 })).actions;
    assert!(few[..20] == trusting[..20] && few[20..] != trusting[20..40]);
    // The first episode's goal is trusted, that of the second is not.
    let two = transitions(&model, json!({ "samples": 80 }));
    let second = two.goal_index[40] as usize;
    assert_ne!(second, two.goal_index[0] as usize);
    let half = transitions(&doubting(&[second]), json!({ "samples": 80 })).actions;
    let at = 60 * 2;
    assert!(half[..at] == two.actions[..at] && half[at..].iter().zip(&two.actions[at..]).all(|(a, b)| a != b));
}
