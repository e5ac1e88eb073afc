//! The form of a model's widths in `model.json`.

use anyhow::ensure;
use serde::{Deserialize, Serialize};

use crate::{
    lce::{BackwardSizes, Differences, ImageNetworks, PassiveDynamics, SharedFrames, Sizes, shared_frames::FRAMES},
    nn::binary_images::{Likelihood, PooledPatches},
};

/// [`Sizes`] with the names and in the order of the file.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SizesFile {
    pixels: usize,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    shades: Option<Likelihood>,
    latent: usize,
    action: usize,
    /// Frames, rows and columns, of convolutional networks.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    convolution: Option<[usize; 3]>,
    /// Patches, of networks that read patches.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    squares: Option<PooledPatches>,
    /// Patches, coordinates and differences, of networks that treat every frame alike.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    shared_frames: Option<SharedFramesFile>,
    encoder: [usize; 2],
    decoder: [usize; 2],
    dynamics: [usize; 2],
    /// N_z, N_u, N_x and N_joint.
    backward: [usize; 4],
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    slopes: bool,
    /// Whether F is a locally linear transition.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    locally_linear: bool,
    #[serde(default, skip_serializing_if = "PassiveDynamics::is_none")]
    drift: PassiveDynamics,
}

/// [`SharedFrames`] as the file has them.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct SharedFramesFile {
    columns: usize,
    side: usize,
    predicted_side: usize,
    coordinates: usize,
    differences: Differences,
}

impl From<SharedFrames> for SharedFramesFile {
    fn from(frames: SharedFrames) -> Self {
        let SharedFrames { read: PooledPatches { columns, side }, predicted, coordinates, differences } = frames;
        Self { columns, side, predicted_side: predicted.side, coordinates, differences }
    }
}

impl From<SharedFramesFile> for SharedFrames {
    fn from(file: SharedFramesFile) -> Self {
        let SharedFramesFile { columns, side, predicted_side, coordinates, differences } = file;
        let patches = |side| PooledPatches { columns, side };
        Self { read: patches(side), predicted: patches(predicted_side), coordinates, differences }
    }
}

impl From<&Sizes> for SizesFile {
    fn from(sizes: &Sizes) -> Self {
        let BackwardSizes { z, u, x, joint } = sizes.backward;
        let (mut convolution, mut squares, mut shared_frames) = (None, None, None);
        match sizes.images {
            ImageNetworks::Dense => {}
            ImageNetworks::Convolutional { frames, rows, columns } => convolution = Some([frames, rows, columns]),
            ImageNetworks::Patches(patches) => squares = Some(patches),
            ImageNetworks::SharedFrames(frames) => shared_frames = Some(frames.into()),
        }
        Self {
            pixels: sizes.pixels,
            shades: sizes.shades,
            latent: sizes.latent,
            action: sizes.action,
            convolution,
            squares,
            shared_frames,
            encoder: sizes.encoder,
            decoder: sizes.decoder,
            dynamics: sizes.dynamics,
            backward: [z, u, x, joint],
            slopes: sizes.jacobian_heads,
            locally_linear: sizes.locally_linear,
            drift: sizes.passive_dynamics,
        }
    }
}

impl TryFrom<SizesFile> for Sizes {
    type Error = anyhow::Error;

    fn try_from(file: SizesFile) -> anyhow::Result<Self> {
        let images = match (file.convolution, file.squares, file.shared_frames) {
            (None, None, None) => ImageNetworks::Dense,
            (Some([frames, rows, columns]), None, None) => ImageNetworks::Convolutional { frames, rows, columns },
            (None, Some(patches), None) => ImageNetworks::Patches(patches),
            (None, None, Some(frames)) => ImageNetworks::SharedFrames(frames.into()),
            _ => anyhow::bail!("only one of `convolution`, `squares` and `shared_frames` may be given"),
        };
        let [z, u, x, joint] = file.backward;
        let sizes = Self {
            pixels: file.pixels,
            shades: file.shades,
            latent: file.latent,
            action: file.action,
            images,
            encoder: file.encoder,
            decoder: file.decoder,
            dynamics: file.dynamics,
            backward: BackwardSizes { z, u, x, joint },
            jacobian_heads: file.slopes,
            locally_linear: file.locally_linear,
            passive_dynamics: file.drift,
        };
        check(&sizes)?;
        Ok(sizes)
    }
}

/// Refuses widths that no network has.
fn check(sizes: &Sizes) -> anyhow::Result<()> {
    let &Sizes { pixels, latent, action, encoder, decoder, dynamics, backward, .. } = sizes;
    let BackwardSizes { z, u, x, joint } = backward;
    check_widths([pixels, latent, action, z, u, x, joint].iter().chain(&encoder).chain(&decoder).chain(&dynamics))?;
    if let Some(Likelihood::Gaussian(noise)) = sizes.shades {
        ensure!(noise.sigma.is_finite() && noise.sigma > 0.0, "the deviation of pixels is {}", noise.sigma);
    }
    ensure!(!(sizes.jacobian_heads && sizes.locally_linear), "a locally linear F has no heads for slopes");
    match sizes.images {
        ImageNetworks::Dense => {}
        ImageNetworks::Convolutional { frames, rows, columns } => {
            check_widths(&[frames, rows, columns])?;
            let smallest = (rows / 8) * (columns / 8);
            ensure!(
                rows % 8 == 0
                    && columns % 8 == 0
                    && frames.saturating_mul(rows).saturating_mul(columns) == pixels
                    && encoder[0].is_multiple_of(smallest)
                    && decoder[1].is_multiple_of(smallest),
                "convolutions of {frames} frames of {rows} x {columns} pixels do not match the other widths"
            );
        }
        ImageNetworks::Patches(patches) => check_patches(patches, pixels)?,
        ImageNetworks::SharedFrames(frames) => check_shared_frames(frames, sizes)?,
    }
    Ok(())
}

fn check_patches(PooledPatches { columns, side }: PooledPatches, pixels: usize) -> anyhow::Result<()> {
    check_widths(&[columns])?;
    ensure!(
        (1..=15).contains(&side) && columns % side == 0 && pixels.is_multiple_of(columns * side),
        "patches of {side} pixels in {columns} columns do not match observations of {pixels} pixels"
    );
    Ok(())
}

fn check_shared_frames(frames: SharedFrames, sizes: &Sizes) -> anyhow::Result<()> {
    let SharedFrames { read, predicted, coordinates, differences } = frames;
    ensure!(sizes.pixels.is_multiple_of(FRAMES), "{} pixels cannot be divided into {FRAMES} frames", sizes.pixels);
    for patches in [read, predicted] {
        check_patches(patches, sizes.pixels / FRAMES)?;
    }
    ensure!(
        predicted.side.is_multiple_of(read.side),
        "the side of predicted patches, {}, is not a multiple of the side of read patches, {}",
        predicted.side,
        read.side
    );
    let (scale, mixed) = match differences {
        Differences::None => (1.0, 1),
        Differences::Scaled { scale } => (scale, 1),
        Differences::Mixed { scale, coordinates } => (scale, coordinates),
    };
    check_widths(&[coordinates, mixed])?;
    ensure!(scale.is_finite() && scale > 0.0, "the scale of differences must be above 0, but is {scale}");
    ensure!(
        frames.latent() == sizes.latent,
        "the frames give codes of {} coordinates, but the latent space has {}",
        frames.latent(),
        sizes.latent
    );
    Ok(())
}

/// Refuses widths of 0 and widths that no memory could hold, before anything is computed from them.
pub(super) fn check_widths<'a>(widths: impl IntoIterator<Item = &'a usize>) -> anyhow::Result<()> {
    for &width in widths {
        ensure!((1..=1 << 24).contains(&width), "a width of {width}");
    }
    Ok(())
}
