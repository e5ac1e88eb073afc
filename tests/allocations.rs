//! Hot loops allocate nothing: after one call of each kind, training steps at the paper's sizes ask for no memory.
//!
//! Counted with one thread of work. `CARL_SHOW_ALLOCATIONS=1` prints where the first few come from.
#[path = "support/allocator.rs"]
mod allocator;
#[path = "support/models.rs"]
mod models;

use allocator::{Asked, asked};
use carl_pipe::{
    control::{
        Agent,
        regularizer::PolicyRegularizer,
        sac::{self, Codes, Learner, Sac, SacTrainer},
    },
    lce::{
        Differences, Ensemble, LceModel, PassiveDynamics,
        ensemble::{Fit, Moves},
        trainer::{self, Data, Objective, Trainer},
        warm_up::WarmUp,
    },
    nn::{
        adam::{Adam, AdamSettings},
        mat,
    },
    num::rng::Rng,
    solar::{self, SolarModel, trainer::SolarTrainer},
};
use models::{
    convolutional_model_and_data, every_term, every_term_of_e2c, every_term_of_pc3, every_term_of_rce, locally_linear,
    model_and_data, sac_settings, shared_frames_model_and_data,
};
use rand::SeedableRng as _;

/// Two whole batches.
const SAMPLES: usize = 2 * trainer::BATCH;
const NOTHING: Asked = Asked { times: 0, bytes: 0, largest: 0 };

#[test]
fn the_counter_counts() {
    let one = asked(|| drop(std::hint::black_box(Vec::<u8>::with_capacity(77))));
    assert_eq!(one, Asked { times: 1, bytes: 77, largest: 77 });
}

/// faer packs large factors into one buffer for each thread, which it sets up at the thread's first product of that
/// size: twice the third-level cache, of which only what is used becomes real memory (private-gemm-x86, `MEM`).
#[test]
fn large_products_allocate_once_for_each_thread_and_small_ones_never() {
    let of_shape = |(m, k, n): (usize, usize, usize)| {
        let (w, x, mut out) = (vec![0.5_f32; m * k], vec![0.5; k * n], vec![0.0; m * n]);
        asked(|| mat::product(&mut out, mat::Accumulate::Replace, &w, &x, (m, k, n)))
    };
    let work = move || {
        let small = of_shape((20, 4, 16));
        let first = of_shape((300, 300, 256));
        (small, first, [(1600, 300, 384), (256, 256, 128), (300, 300, 256), (20, 4, 256)].map(of_shape))
    };
    let (small, first, later) = std::thread::spawn(work).join().expect("a thread");
    assert_eq!(small, NOTHING);
    assert!(first.times <= 2, "{first:?}");
    assert_eq!(later, [NOTHING; 4]);
}

#[test]
fn a_training_step_of_the_representation_allocates_nothing() {
    let (mut drifting, of_drifting) = model_and_data(SAMPLES);
    drifting.set_passive_dynamics(PassiveDynamics::Quadratic);
    let convolutional = convolutional_model_and_data(SAMPLES);
    let mixed = shared_frames_model_and_data(Differences::Mixed { scale: 2.0, coordinates: 1 }, SAMPLES);
    let scaled = shared_frames_model_and_data(Differences::Scaled { scale: 2.0 }, SAMPLES);
    for (model, data) in [model_and_data(SAMPLES), (drifting, of_drifting), convolutional, mixed, scaled] {
        a_training_step_allocates_nothing(model, &data);
    }
}

fn a_training_step_allocates_nothing(model: LceModel, data: &Data) {
    let adam = Adam::new(model.arena.len());
    let mut trainer = Trainer::new(model, adam, AdamSettings { learning_rate: 5e-4, weight_decay: 1e-3 });
    let warm_up = WarmUp { sigma: 0.3, scale: 1.0, anchor: 30.0, huber_delta: 3.0, shrink: 0.01 };
    let guidance = vec![0.5; data.len()];
    let objective = Objective {
        weights: every_term(),
        curvature_sigma: 0.1,
        anchor_scale: 1.0,
        guidance: Some(&guidance),
        regularizer: None,
    };
    // L_reg against a frozen policy, as the stage puts it together.
    let agent = Agent::new(2, 2, None, 0.0, &mut Rng::seed_from_u64(7));
    let codes: Vec<f32> = (0..2 * data.len()).map(|i| (i % 9) as f32 * 0.1).collect();
    let l_reg = PolicyRegularizer::new(&agent, &codes, &codes);
    let l_reg = |transition: usize, z: &[f32], weight: f32, d_z: &mut [f32]| l_reg.at(transition, z, weight, d_z);
    let objective = Objective { regularizer: Some(&l_reg), ..objective };
    let mut rng = Rng::seed_from_u64(3);
    let which: Vec<u32> = (0..data.len() as u32).collect();
    let (first, second) = which.split_at(trainer::BATCH);
    // The last batch of an epoch is smaller than the others.
    let later = [second, first, &second[..37]];
    trainer.warm_up_step(1, data, first, &warm_up, true, &mut rng);
    for which in later {
        let asked = asked(|| _ = trainer.warm_up_step(1, data, which, &warm_up, true, &mut rng));
        assert_eq!(asked, NOTHING, "warm-up, {} samples", which.len());
    }
    // Buffers of the warm-up make room for those of the loss.
    trainer.step(1, data, first, &objective, &mut rng);
    for which in later {
        let asked = asked(|| _ = trainer.step(1, data, which, &objective, &mut rng));
        assert_eq!(asked, NOTHING, "{} samples", which.len());
    }
    trainer.pc3_step(1, data, first, &every_term_of_pc3(), &mut rng);
    for which in later {
        let asked = asked(|| _ = trainer.pc3_step(1, data, which, &every_term_of_pc3(), &mut rng));
        assert_eq!(asked, NOTHING, "PC3, {} samples", which.len());
    }
    let model = locally_linear(&trainer.model);
    let adam = Adam::new(model.arena.len());
    let mut trainer = Trainer::new(model, adam, AdamSettings { learning_rate: 5e-4, weight_decay: 1e-3 });
    trainer.e2c_step(1, data, first, &every_term_of_e2c(), &mut rng);
    for which in later {
        let asked = asked(|| _ = trainer.e2c_step(1, data, which, &every_term_of_e2c(), &mut rng));
        assert_eq!(asked, NOTHING, "E2C, {} samples", which.len());
    }
    trainer.rce_step(1, data, first, &every_term_of_rce(), &mut rng);
    for which in later {
        let asked = asked(|| _ = trainer.rce_step(1, data, which, &every_term_of_rce(), &mut rng));
        assert_eq!(asked, NOTHING, "RCE, {} samples", which.len());
    }
}

#[test]
fn a_training_step_of_solar_allocates_nothing() {
    const STEPS: usize = 40;
    let (model, data) = model_and_data(3 * STEPS / 2);
    let sizes = model.sizes.clone();
    let data = solar::trainer::Data {
        actions: data.actions.iter().chain(&data.actions).map(|&u| f64::from(u)).collect(),
        costs: vec![1.0; 3 * STEPS],
        images: data.images,
        steps: STEPS,
    };
    for transitions in [STEPS - 1, 1] {
        let mut solar =
            SolarModel::new(sizes.clone(), model.background.clone(), transitions, None, &mut Rng::seed_from_u64(8));
        let settings = solar::trainer::Settings { learning_rate: 1e-3, clip: 5.0, dynamics_rate: 8e-4 };
        let mut trainer = SolarTrainer::new(&solar, settings, STEPS, 2);
        let mut rng = Rng::seed_from_u64(9);
        trainer.step(1, &mut solar, &data, &[0, 2], 0.5, &mut rng);
        for batch in [&[1, 0][..], &[2]] {
            let asked = asked(|| _ = trainer.step(1, &mut solar, &data, batch, 0.5, &mut rng));
            assert_eq!(asked, NOTHING, "{} trajectories, {transitions} transitions", batch.len());
            assert!(trainer.is_finite());
        }
    }
}

#[test]
fn a_training_step_of_the_agent_allocates_nothing() {
    let (model, data) = model_and_data(SAMPLES);
    let actions = [&data.actions[..], &data.actions].concat();
    let codes = Codes { data: model.encode(&data.images), actions, goals: vec![0.1, -0.2, 0.5, 0.5] };
    let fit = Fit { members: 3, steps: 2, learning_rate: 1e-3 };
    let moves = Moves { codes: &model.encode(&data.images), actions: &data.actions, copies: data.copies };
    let ensemble = Ensemble::fit(&model.sizes, moves, fit, &mut Rng::seed_from_u64(6)).unwrap();
    // Full, and over, within the steps below.
    let settings = sac_settings(5 * sac::BATCH + 11);
    for settings in [settings.clone(), Sac { buffer: 1_000_000, ..settings }] {
        let agent = Agent::new(2, 2, None, 0.0, &mut Rng::seed_from_u64(4));
        let learner = Learner::new(agent, settings.buffer, Rng::seed_from_u64(5));
        let mut trainer = SacTrainer::new(learner, &model, &codes, settings).with_ensemble(&ensemble);
        trainer.step(1, 1.0);
        for step in 0..7 {
            assert_eq!(asked(|| _ = trainer.step(1, 1.0)), NOTHING, "step {step}");
        }
    }
}
