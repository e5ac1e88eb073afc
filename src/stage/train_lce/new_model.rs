//! The networks of a new model.

use super::params::{FramePatches, Networks, Params, Slopes, Widths};
use crate::{
    artifact::{TrainedModel, Transitions},
    lce::{BackwardSizes, ImageNetworks, LceModel, SharedFrames, Sizes, model::background_of, shared_frames::FRAMES},
    nn::{
        adam::Adam,
        binary_images::{Likelihood, PooledPatches},
    },
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
    if params.likelihood != Likelihood::default() {
        sizes.shades = Some(params.likelihood);
    }
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
    written_widths(&params.widths, &mut sizes)?;
    let background = background_of(&transitions.frames(), &sizes);
    let model = LceModel::new(sizes, background, rng);
    let adam = Adam::new(model.arena.len());
    Ok(TrainedModel { model, adam, suspect_goals: Vec::new() })
}

/// Puts the widths that the file writes in place of the others.
fn written_widths(widths: &Widths, sizes: &mut Sizes) -> anyhow::Result<()> {
    let both = |written: Option<[u64; 2]>, usual| written.map_or(usual, |two| two.map(|width| width as usize));
    sizes.latent = widths.latent.map_or(sizes.latent, |latent| latent as usize);
    sizes.encoder = both(widths.encoder, sizes.encoder);
    sizes.decoder = both(widths.decoder, sizes.decoder);
    sizes.dynamics = both(widths.dynamics, sizes.dynamics);
    if let ImageNetworks::Convolutional { rows, columns, .. } = sizes.images {
        let smallest = (rows / 8) * (columns / 8);
        anyhow::ensure!(
            sizes.encoder[0].is_multiple_of(smallest) && sizes.decoder[1].is_multiple_of(smallest),
            "convolutions of {rows} x {columns} pixels need a multiple of {smallest} as the first width of \
             `widths.encoder` and the last of `widths.decoder`"
        );
    }
    Ok(())
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
