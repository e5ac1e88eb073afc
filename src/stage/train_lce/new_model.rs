//! The networks of a new model.

use super::params::{FramePatches, Networks, Params, Slopes};
use crate::{
    artifact::{TrainedModel, Transitions},
    lce::{BackwardSizes, ImageNetworks, LceModel, SharedFrames, Sizes, model::background, shared_frames::FRAMES},
    nn::{adam::Adam, binary_images::PooledPatches},
    num::rng::Rng,
};

/// A model with random weights, for observations of so many frames.
pub(super) fn random_model(
    params: &Params,
    transitions: &Transitions,
    mut sizes: Sizes,
    frames: usize,
    rng: &mut Rng,
) -> anyhow::Result<TrainedModel> {
    sizes.jacobian_heads = params.slopes == Slopes::Amortized;
    sizes.locally_linear = params.objective.is_locally_linear();
    match params.networks {
        Networks::Paper => {}
        Networks::PooledPatches(patches) => {
            let patches = cut(transitions.picture, patches.side, "networks.pooled_patches.side")?;
            sizes = reading_patches(ImageNetworks::Patches(patches), sizes);
        }
        Networks::SharedFrames(patches) => {
            let frames = shared_frames(patches, transitions.picture, frames)?;
            sizes = Sizes { latent: frames.latent(), ..reading_patches(ImageNetworks::SharedFrames(frames), sizes) };
        }
    }
    let background = background(&transitions.frames(), transitions.pixels());
    let model = LceModel::new(sizes, background, rng);
    let adam = Adam::new(model.arena.len());
    Ok(TrainedModel { model, adam, suspect_goals: Vec::new() })
}

/// Widths of networks that read patches.
fn reading_patches(images: ImageNetworks, sizes: Sizes) -> Sizes {
    let (hidden, backward) = ([128; 2], BackwardSizes { z: 10, u: 10, x: 50, joint: 100 });
    Sizes { images, encoder: hidden, decoder: hidden, backward, ..sizes }
}

fn shared_frames(
    patches: FramePatches,
    (rows, columns): (usize, usize),
    frames: usize,
) -> anyhow::Result<SharedFrames> {
    anyhow::ensure!(
        frames == FRAMES,
        "`networks = \"shared_frames\"` needs observations of {FRAMES} frames; those of the task have {frames}"
    );
    let frame = (rows / FRAMES, columns);
    Ok(SharedFrames {
        read: cut(frame, patches.side, "networks.shared_frames.side")?,
        predicted: cut(frame, patches.predicted_side, "networks.shared_frames.predicted_side")?,
        coordinates: patches.coordinates as usize,
        differences: patches.differences,
    })
}

/// The patches of a picture with rows and columns of pixels.
fn cut((rows, columns): (usize, usize), side: u64, parameter: &str) -> anyhow::Result<PooledPatches> {
    let side = side as usize;
    anyhow::ensure!(
        rows % side == 0 && columns % side == 0,
        "pictures of {rows} x {columns} pixels cannot be cut into patches of {side} x {side}: change `{parameter}`"
    );
    Ok(PooledPatches { columns, side })
}
