//! Tiny models of every kind, with a batch.

use carl_pipe::{
    lce::{
        BackwardSizes, Differences, ImageNetworks, LceModel, PassiveDynamics, SharedFrames, Sizes, objective::Noise,
    },
    nn::{
        binary_images::{BinaryImages, PooledPatches},
        mlp::Linear,
    },
    num::{rng::Rng, sampling},
};
use rand::SeedableRng as _;

use super::random;

/// A tiny model, its images and a batch.
pub(super) struct Case {
    pub(super) model: LceModel<f64>,
    pub(super) pictures: BinaryImages,
    pub(super) pairs: Vec<u32>,
    pub(super) x: Vec<u32>,
    pub(super) actions: Vec<f64>,
    pub(super) noise: Vec<f64>,
    pub(super) guidance: Vec<f64>,
    /// How many parameters of a layer are checked.
    pub(super) each: usize,
}

pub(super) const SAMPLES: usize = 5;

/// One model of every kind.
pub(super) fn every_case() -> Vec<Case> {
    let mut cases = shared_frames_cases();
    cases.extend([case(2, 2), case(3, 1), amortized_case(), drifting_case(), patches_case(), convolutional_case()]);
    cases
}

pub(super) fn case(latent: usize, action: usize) -> Case {
    case_of(Sizes {
        shades: None,
        jacobian_heads: false,
        locally_linear: false,
        passive_dynamics: PassiveDynamics::None,
        pixels: 23,
        latent,
        action,
        images: ImageNetworks::Dense,
        encoder: [7, 6],
        decoder: [5, 7],
        dynamics: [6, 5],
        backward: BackwardSizes { z: 3, u: 4, x: 5, joint: 6 },
    })
}

/// Two frames of 16 rows and 24 columns: 2x3 pixels where the image is smallest, of 2 and of 3 channels.
fn convolutional_case() -> Case {
    case_of(Sizes {
        shades: None,
        jacobian_heads: false,
        locally_linear: false,
        passive_dynamics: PassiveDynamics::None,
        pixels: 2 * 16 * 24,
        latent: 3,
        action: 2,
        images: ImageNetworks::Convolutional { frames: 2, rows: 16, columns: 24 },
        encoder: [2 * 6, 7],
        decoder: [6, 3 * 6],
        dynamics: [6, 5],
        backward: BackwardSizes { z: 3, u: 4, x: 5, joint: 6 },
    })
}

/// Six patches of 2x2 pixels.
fn patches_case() -> Case {
    let Case { model, .. } = case(2, 1);
    let images = ImageNetworks::Patches(PooledPatches { columns: 6, side: 2 });
    case_of(Sizes { pixels: 4 * 6, images, ..model.sizes })
}

/// Networks that read each of two frames of 8 rows and 8 columns, with differences of every form.
fn shared_frames_cases() -> Vec<Case> {
    let (scaled, mixed) = (Differences::Scaled { scale: 1.7 }, Differences::Mixed { scale: 1.7, coordinates: 2 });
    let cases = [Differences::None, scaled, mixed].map(|differences| {
        let [read, predicted] = [2, 4].map(|side| PooledPatches { columns: 8, side });
        let frames = SharedFrames { read, predicted, coordinates: 3, differences };
        let Case { model, .. } = case(frames.latent(), 2);
        let (images, passive_dynamics) = (ImageNetworks::SharedFrames(frames), PassiveDynamics::Quadratic);
        case_of(Sizes { pixels: 2 * 8 * 8, images, passive_dynamics, ..model.sizes })
    });
    cases.into()
}

/// A model with heads for F's Jacobians.
pub(super) fn amortized_case() -> Case {
    let Case { model, .. } = case(2, 1);
    case_of(Sizes { jacobian_heads: true, ..model.sizes })
}

/// A model with passive dynamics and three coordinates.
pub(super) fn drifting_case() -> Case {
    let Case { model, .. } = case(3, 1);
    let mut case = case_of(Sizes { passive_dynamics: PassiveDynamics::Quadratic, ..model.sizes });
    // Passive dynamics begin at zero, where many gradients are zero, too.
    let (name, layer) = case.model.nets.layout.layers.last().expect("layers");
    assert_eq!(name, "drift");
    let drift = &mut case.model.arena[layer.at..layer.at + layer.len()];
    assert_eq!(drift, [0.0; 3 * (1 + 3 + 6)]);
    drift.copy_from_slice(&random(&mut Rng::seed_from_u64(9), drift.len()));
    case.each = 30;
    case
}

/// Models with a locally linear F: planar-like, with passive dynamics, and on patches.
pub(super) fn locally_linear_cases() -> [Case; 3] {
    [case(2, 2), case(3, 1), patches_case()].map(|Case { model, .. }| {
        let passive_dynamics = if model.sizes.latent == 3 { PassiveDynamics::Quadratic } else { PassiveDynamics::None };
        case_of(Sizes { locally_linear: true, passive_dynamics, ..model.sizes })
    })
}

fn case_of(sizes: Sizes) -> Case {
    let mut rng = Rng::seed_from_u64(6);
    let (pixels, latent, action) = (sizes.pixels, sizes.latent, sizes.action);
    let frames: Vec<u8> = (0..2 * SAMPLES * pixels).map(|_| u8::from(sampling::index(&mut rng, 4) == 0)).collect();
    let background = carl_pipe::lce::model::background(&frames, pixels);
    let mut model = LceModel::<f64>::new(sizes, background, &mut rng);
    // Weights are larger than those of a new model, so that no part of the loss is flat.
    model.arena.iter_mut().for_each(|w| *w *= 1.8);
    let pictures = model.pictures(&frames);
    let pairs: Vec<u32> = (0..2 * SAMPLES as u32).rev().collect();
    let mut noise = vec![0.0; SAMPLES * Noise::<f64>::width(latent, action)];
    sampling::fill_normal(&mut rng, &mut noise);
    Case {
        x: pairs.iter().step_by(2).copied().collect(),
        pairs,
        actions: random(&mut rng, SAMPLES * action),
        noise,
        guidance: random(&mut rng, SAMPLES).iter().map(|w| 1.5 + w).collect(),
        each: if matches!(model.sizes.images, ImageNetworks::Convolutional { .. }) { 4 } else { 12 },
        model,
        pictures,
    }
}

/// Up to `each` parameters of every layer, weights and biases.
pub(super) fn some_of(layers: &[(String, Linear)], each: usize) -> Vec<(String, Vec<usize>)> {
    let mut rng = Rng::seed_from_u64(7);
    let choose = |(name, layer): &(String, Linear)| {
        let mut which: Vec<u32> = (layer.at as u32..(layer.at + layer.len()) as u32).collect();
        sampling::shuffle(&mut rng, &mut which);
        let last = layer.at + layer.len() - 1;
        (name.clone(), which.iter().take(each).map(|&i| i as usize).chain([last]).collect())
    };
    layers.iter().map(choose).collect()
}
