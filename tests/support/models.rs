//! Models with random weights, and data for them.

use carl_pipe::{
    artifact::Transitions,
    control::sac::{CriticActions, Reward, Sac, Temperature, Tuning},
    env::{Planar, System as _},
    lce::{
        BackwardSizes, Differences, ImageNetworks, LceModel, PassiveDynamics, SharedFrames, Sizes, e2c::E2cLoss,
        model::background, objective::Weights, pc3::Pc3Loss, rce::RceLoss, trainer::Data,
    },
    nn::binary_images::PooledPatches,
    num::{rng::Rng, sampling},
    stage::network_sizes,
};
use rand::SeedableRng as _;

/// Transitions of single random steps in the planar system.
fn transitions(samples: usize) -> Transitions {
    let planar = Planar { noise: 0.0 };
    let mut rng = Rng::seed_from_u64(1);
    let mut transitions =
        Transitions { picture: planar.frames().observation(), action_dim: 2, ..Transitions::default() };
    for goal in planar.goals() {
        transitions.goals.extend(planar.observe_at_rest(&goal));
    }
    for _ in 0..samples {
        let (state, action) = (planar.sample_state(&mut rng).expect("a state"), planar.sample_action(&mut rng));
        let next = planar.step(&state, &action, &mut rng);
        let scaled: Vec<f32> = action.iter().map(|u| (u / 3.0) as f32).collect();
        transitions.push(&planar.observe_at_rest(&state), &scaled, &planar.observe_at_rest(&next), 0);
    }
    transitions
}

/// A model of the paper's sizes and data for it.
pub fn model_and_data(samples: usize) -> (LceModel, Data) {
    let transitions = transitions(samples);
    let background = background(&transitions.frames(), transitions.pixels());
    let planar = serde_json::from_value(serde_json::json!({ "env": "planar" })).expect("a task");
    let model = LceModel::new(network_sizes(&planar), background, &mut Rng::seed_from_u64(2));
    let images = model.pictures(&transitions.frames());
    let data = Data { images, actions: transitions.actions, action_dim: transitions.action_dim, copies: 1 };
    (model, data)
}

/// A small convolutional model on two frames of random pictures.
pub fn convolutional_model_and_data(samples: usize) -> (LceModel, Data) {
    let images = ImageNetworks::Convolutional { frames: 2, rows: 16, columns: 24 };
    of_two_frames(Sizes { images, ..two_frames() }, samples)
}

/// A small model that reads each of two frames of random pictures by the same network, with differences of this form.
pub fn shared_frames_model_and_data(differences: Differences, samples: usize) -> (LceModel, Data) {
    let [read, predicted] = [2, 4].map(|side| PooledPatches { columns: 24, side });
    let frames = SharedFrames { read, predicted, coordinates: 1, differences };
    of_two_frames(
        Sizes { images: ImageNetworks::SharedFrames(frames), latent: frames.latent(), ..two_frames() },
        samples,
    )
}

/// Widths for two frames of 16 rows and 24 columns.
fn two_frames() -> Sizes {
    Sizes {
        shades: None,
        pixels: 2 * 16 * 24,
        latent: 2,
        action: 2,
        images: ImageNetworks::Dense,
        jacobian_heads: false,
        locally_linear: false,
        passive_dynamics: PassiveDynamics::None,
        encoder: [60, 20],
        decoder: [20, 60],
        dynamics: [8, 8],
        backward: BackwardSizes { z: 3, u: 3, x: 10, joint: 10 },
    }
}

fn of_two_frames(sizes: Sizes, samples: usize) -> (LceModel, Data) {
    let mut rng = Rng::seed_from_u64(1);
    let frames: Vec<u8> =
        (0..2 * samples * sizes.pixels).map(|_| u8::from(sampling::index(&mut rng, 20) == 0)).collect();
    let actions = (0..2 * samples).map(|_| sampling::uniform(&mut rng, -1.0, 1.0)).collect();
    let background = background(&frames, sizes.pixels);
    let model = LceModel::new(sizes, background, &mut rng);
    let data = Data { images: model.pictures(&frames), actions, action_dim: 2, copies: 1 };
    (model, data)
}

/// Weights with which every term of the loss counts.
pub fn every_term() -> Weights {
    Weights {
        reconstruction: 1.0,
        consistency: 8.0,
        curvature: 1.0,
        encode_decode: 0.01,
        prior: 0.01,
        deterministic: 0.3,
        regularizer: 0.1,
        anchor: 3.0,
    }
}

/// PC3's loss with every term.
pub fn every_term_of_pc3() -> Pc3Loss {
    Pc3Loss {
        nce: 1.0,
        consistency: 1.0,
        curvature: 7.0,
        center: 0.1,
        anchor: 3.0,
        sigma: 0.1,
        curvature_sigma: 0.1,
        anchor_scale: 1.0,
    }
}

/// E2C's loss with every term.
pub fn every_term_of_e2c() -> E2cLoss {
    E2cLoss { encode_decode: 1.0, prediction: 1.0, prior: 1.0, transition_kl: 0.25, anchor: 3.0, anchor_scale: 1.0 }
}

/// RCE's loss with every term.
pub fn every_term_of_rce() -> RceLoss {
    RceLoss { reconstruction: 1.0, consistency: 1.0, anchor: 3.0, anchor_scale: 1.0 }
}

/// A model like this one with random weights and a locally linear F.
pub fn locally_linear(model: &LceModel) -> LceModel {
    let sizes = Sizes { locally_linear: true, ..model.sizes.clone() };
    LceModel::new(sizes, model.background.clone(), &mut Rng::seed_from_u64(2))
}

/// SAC with bootstrapped targets and a latent buffer of this many tuples.
pub fn sac_settings(buffer: usize) -> Sac {
    Sac {
        discount: 0.99,
        rollout: 5,
        bootstrap: true,
        tau: 0.005,
        policy_ema_rate: 0.005,
        actor_learning_rate: 5e-4,
        critic_learning_rate: 1e-3,
        temperature: Temperature::Tuned(Tuning::default()),
        reward: Reward::Distance,
        speed_weight: 1.0,
        antifriction: 0.0,
        relabel: 0.5,
        critic_actions: CriticActions::Uniform,
        buffer,
    }
}
