//! Results depend on parameters, inputs and named streams alone: no thread count, no name, no earlier draw.

use crate::support::stages;
use std::collections::BTreeSet;

use crate::support::models::{
    convolutional_model_and_data, every_term, every_term_of_e2c, every_term_of_pc3, every_term_of_rce, locally_linear,
    model_and_data, sac_settings, shared_frames_model_and_data,
};
use carl_pipe::{
    control::{
        Agent,
        sac::{Codes, Learner, SacTrainer},
    },
    lce::{
        Differences, LceModel, PassiveDynamics,
        trainer::{Data, Objective, Trainer},
        warm_up::WarmUp,
    },
    nn::adam::{Adam, AdamSettings},
    num::{
        rng::{Purpose, Rng, Stream},
        sampling,
    },
    pipeline::{self, Graph, Overrides, Source},
    stage,
};
use rand::{RngExt as _, SeedableRng as _};
use serde_json::json;

fn on_threads<R: Send>(threads: usize, work: impl FnOnce() -> R + Send) -> R {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads").install(work)
}

fn bits(values: &[f32]) -> Vec<u32> {
    values.iter().map(|x| x.to_bits()).collect()
}

#[test]
fn threads_change_no_bit_of_the_representation() {
    let (mut drifting, of_drifting) = model_and_data(128);
    drifting.set_passive_dynamics(PassiveDynamics::Quadratic);
    let mixed = shared_frames_model_and_data(Differences::Mixed { scale: 2.0, coordinates: 1 }, 128);
    let convolutional = convolutional_model_and_data(128);
    let scaled = shared_frames_model_and_data(Differences::Scaled { scale: 2.0 }, 128);
    for (model, data) in [model_and_data(128), (drifting, of_drifting), convolutional, mixed, scaled] {
        threads_change_no_bit_of(&model, &data);
    }
}

fn threads_change_no_bit_of(model: &LceModel, data: &Data) {
    let guidance: Vec<f32> = (0..128).map(|i| 0.5 + (i % 7) as f32 * 0.1).collect();
    let pull = |transition: usize, z: &[f32], weight: f32, d_z: &mut [f32]| {
        let steep = 1.0 + transition as f32 * 0.01;
        d_z.iter_mut().zip(z).for_each(|(d, z)| *d += weight * steep * z);
        z.iter().map(|z| 0.5 * steep * z * z).sum()
    };
    let objective = Objective {
        weights: every_term(),
        curvature_sigma: 0.1,
        anchor_scale: 1.0,
        guidance: Some(&guidance),
        regularizer: Some(&pull),
    };
    let warm_up = WarmUp { sigma: 0.3, scale: 1.0, anchor: 30.0, huber_delta: 3.0, shrink: 0.01 };
    let settings = AdamSettings { learning_rate: 5e-4, weight_decay: 1e-3 };
    // A whole batch, one that no number of threads divides, and a single sample.
    let batches: [Vec<u32>; 3] = [(0..128).collect(), (0..61).rev().collect(), vec![5]];
    let train = |threads: usize| {
        on_threads(threads, || {
            let mut trainer = Trainer::new(model.clone(), Adam::new(model.arena.len()), settings);
            let mut rng = Rng::seed_from_u64(3);
            let mut terms = Vec::new();
            for which in &batches {
                let warm = trainer.warm_up_step(threads, data, which, &warm_up, true, &mut rng);
                let after_warm_up = bits(&trainer.model.arena);
                let loss = trainer.step(threads, data, which, &objective, &mut rng);
                let pc3 = trainer.pc3_step(threads, data, which, &every_term_of_pc3(), &mut rng);
                terms.push((warm, after_warm_up, loss, pc3));
            }
            let model = locally_linear(model);
            let adam = Adam::new(model.arena.len());
            let mut e2c = Trainer::new(model, adam, settings);
            let loss = every_term_of_e2c();
            let e2c_terms = batches.each_ref().map(|which| e2c.e2c_step(threads, data, which, &loss, &mut rng));
            let loss = every_term_of_rce();
            let rce_terms = batches.each_ref().map(|which| e2c.rce_step(threads, data, which, &loss, &mut rng));
            (
                terms,
                bits(&trainer.model.arena),
                bits(&trainer.adam.m),
                bits(&trainer.adam.v),
                (e2c_terms, rce_terms),
                bits(&e2c.model.arena),
            )
        })
    };
    let one = train(1);
    assert_ne!(one.1, bits(&model.arena), "training moves the model");
    for threads in 2..=4 {
        assert!(train(threads) == one, "{threads} threads differ from one");
    }
}

#[test]
fn threads_change_no_bit_of_the_agent() {
    let (model, data) = model_and_data(64);
    let codes = Codes {
        data: model.encode(&data.images),
        actions: [&data.actions[..], &data.actions].concat(),
        goals: vec![0.1, -0.2],
    };
    let train = |threads: usize| {
        on_threads(threads, || {
            let agent = Agent::new(2, 2, None, 0.0, &mut Rng::seed_from_u64(4));
            let learner = Learner::new(agent, sac_settings(1_000).buffer, Rng::seed_from_u64(5));
            let mut trainer = SacTrainer::new(learner, &model, &codes, sac_settings(1_000));
            // More tuples than the buffer holds, so that it wraps.
            let terms: Vec<_> = (0..10).map(|_| trainer.step(threads, 1.0)).collect();
            (terms, trainer.learner.agent)
        })
    };
    let one = train(1);
    for threads in 2..=4 {
        assert!(train(threads) == one, "{threads} threads differ from one");
    }
}

#[test]
fn threads_and_repetition_change_no_byte_of_any_artifact() {
    let bootstrap = stages::run("generate_data", json!({ "samples": 96 }), &[]);
    assert_eq!(bootstrap, stages::run("generate_data", json!({ "samples": 96 }), &[]));
    let few = json!({ "epochs": 2, "warm_up": { "epochs": 1 }, "ramp": { "epochs": 1 } });
    let [model, again] = [1, 3].map(|threads| {
        let inputs: &stages::Inputs<'_> = &[("transitions", &[&bootstrap])];
        stages::run_as("train_lce", few.clone(), inputs, stages::stream("train_lce"), threads)
    });
    assert!(model == again);
    let [agent, again] = [1, 3].map(|threads| {
        let inputs: &stages::Inputs<'_> = &[("transitions", &[&bootstrap]), ("model", &[&model])];
        stages::run_as("train_sac", json!({ "steps": 3 }), inputs, stages::stream("train_sac"), threads)
    });
    assert!(agent == again);
}

#[test]
fn another_seed_round_or_stream_gives_other_data() {
    let base = stages::stream("generate_data");
    let streams = [
        base.clone(),
        Stream { seed: 1, ..base.clone() },
        Stream { round: 1, ..base.clone() },
        Stream { stream: Some("second".to_owned()), ..base },
    ];
    let data = streams.map(|stream| stages::run_as("generate_data", json!({ "samples": 3 }), &[], stream, 1));
    for (i, one) in data.iter().enumerate() {
        assert!(data[i + 1..].iter().all(|other| other != one));
    }
}

#[test]
fn every_part_of_a_streams_name_gives_draws_of_its_own() {
    let first = |mut rng: Rng| rng.random::<u128>();
    let stream = |seed, kind: &str, round, stream: Option<&str>| Stream {
        seed,
        kind: kind.to_owned(),
        round,
        stream: stream.map(str::to_owned),
    };
    let names = [
        (stream(0, "collect", 0, None), Purpose::from("weights")),
        (stream(1, "collect", 0, None), Purpose::from("weights")),
        (stream(0, "collect", 1, None), Purpose::from("weights")),
        (stream(0, "collect", 0, Some("b")), Purpose::from("weights")),
        (stream(0, "evaluate", 0, None), Purpose::from("weights")),
        (stream(0, "collect", 0, None), Purpose::from("weight")),
        (stream(0, "collect", 0, None), Purpose::from(("weights", 1))),
        (stream(0, "collect", 0, None), Purpose::from(("weights", 256))),
        (stream(0, "collec", 0, Some("t")), Purpose::from("weights")),
        (stream(0, "collect", 0, Some("w")), Purpose::from("eights")),
    ];
    let draws: BTreeSet<u128> = names.iter().map(|(stream, purpose)| first(stream.rng(*purpose))).collect();
    assert_eq!(draws.len(), names.len());
    // A shared stream knows the seed and the purpose alone.
    let shared: BTreeSet<u128> =
        names[2..5].iter().map(|(stream, _)| first(stream.shared("episodes".into()))).collect();
    assert_eq!(shared.len(), 1);
    assert_ne!(first(names[0].0.shared("episodes".into())), first(names[1].0.shared("episodes".into())));
}

#[test]
fn a_draw_for_one_purpose_shifts_none_for_another() {
    let stream = stages::stream("train_lce");
    let mut weights = stream.rng("weights".into());
    let before: u64 = stream.rng(("batches", 3).into()).random();
    let _: u64 = weights.random();
    assert_eq!(before, stream.rng(("batches", 3).into()).random::<u64>());
}

fn graph(text: &str) -> Graph {
    let source = Source::new("test.toml", text);
    pipeline::load(&source, &Overrides::default(), stage::registry()).expect("a pipeline")
}

#[test]
fn renaming_a_stage_leaves_its_random_stream_as_it_was() {
    let text = std::fs::read_to_string("pipelines/smoke.toml").expect("a pipeline");
    let mut renamed = text.clone();
    for name in [
        "bootstrap",
        "collect",
        "represent",
        "distill",
        "control",
        "evaluate",
        "plan",
        "evaluate_plan",
        "map",
        "summary",
        "trajectories",
        "represent_solar",
        "plan_solar",
        "evaluate_solar",
    ] {
        for (old, new) in [
            (format!("[stages.{name}]"), format!("[stages.other_{name}]")),
            (format!("\"{name}\""), format!("\"other_{name}\"")),
            (format!("\"{name}@"), format!("\"other_{name}@")),
        ] {
            renamed = renamed.replace(&old, &new);
        }
    }
    // Kinds are written in quotes too.
    let renamed = renamed.replace("kind = \"other_", "kind = \"");
    let (before, after) = (graph(&text), graph(&renamed));
    assert_eq!(before.nodes.len(), after.nodes.len());
    for (before, after) in before.nodes.iter().zip(&after.nodes) {
        assert_eq!(after.name, format!("other_{}", before.name));
        assert_eq!((&before.stream, &before.params), (&after.stream, &after.params), "{}", before.name);
    }
}

#[test]
fn shuffling_is_a_permutation_and_depends_on_the_stream() {
    let order = |seed: u64| {
        let mut order: Vec<u32> = (0..100).collect();
        sampling::shuffle(&mut Rng::seed_from_u64(seed), &mut order);
        order
    };
    assert_ne!(order(1), order(2));
    let mut sorted = order(1);
    sorted.sort_unstable();
    assert!(sorted.into_iter().eq(0..100));
}
