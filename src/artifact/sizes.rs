//! The form of a model's widths in `model.json`.

use anyhow::ensure;
use serde::{Deserialize, Serialize};

use crate::{
    lce::{BackwardSizes, ImageNetworks, PassiveDynamics, Sizes},
    nn::binary_images::PooledPatches,
};

/// [`Sizes`] with the names and in the order of the file.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SizesFile {
    pixels: usize,
    latent: usize,
    action: usize,
    /// Frames, rows and columns, of convolutional networks.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    convolution: Option<[usize; 3]>,
    /// Patches, of networks that read patches.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    squares: Option<PooledPatches>,
    encoder: [usize; 2],
    decoder: [usize; 2],
    dynamics: [usize; 2],
    /// N_z, N_u, N_x and N_joint.
    backward: [usize; 4],
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    slopes: bool,
    #[serde(default, skip_serializing_if = "PassiveDynamics::is_none")]
    drift: PassiveDynamics,
}

impl From<&Sizes> for SizesFile {
    fn from(sizes: &Sizes) -> Self {
        let BackwardSizes { z, u, x, joint } = sizes.backward;
        let (convolution, squares) = match sizes.images {
            ImageNetworks::Dense => (None, None),
            ImageNetworks::Convolutional { frames, rows, columns } => (Some([frames, rows, columns]), None),
            ImageNetworks::Patches(patches) => (None, Some(patches)),
        };
        Self {
            pixels: sizes.pixels,
            latent: sizes.latent,
            action: sizes.action,
            convolution,
            squares,
            encoder: sizes.encoder,
            decoder: sizes.decoder,
            dynamics: sizes.dynamics,
            backward: [z, u, x, joint],
            slopes: sizes.jacobian_heads,
            drift: sizes.passive_dynamics,
        }
    }
}

impl TryFrom<SizesFile> for Sizes {
    type Error = anyhow::Error;

    fn try_from(file: SizesFile) -> anyhow::Result<Self> {
        let images = match (file.convolution, file.squares) {
            (None, None) => ImageNetworks::Dense,
            (Some([frames, rows, columns]), None) => ImageNetworks::Convolutional { frames, rows, columns },
            (None, Some(patches)) => ImageNetworks::Patches(patches),
            (Some(_), Some(_)) => anyhow::bail!("networks are either convolutional or read patches, not both"),
        };
        let [z, u, x, joint] = file.backward;
        let sizes = Self {
            pixels: file.pixels,
            latent: file.latent,
            action: file.action,
            images,
            encoder: file.encoder,
            decoder: file.decoder,
            dynamics: file.dynamics,
            backward: BackwardSizes { z, u, x, joint },
            jacobian_heads: file.slopes,
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
        ImageNetworks::Patches(PooledPatches { columns, side }) => {
            check_widths(&[columns])?;
            ensure!(
                (1..=15).contains(&side) && columns % side == 0 && pixels % (columns * side) == 0,
                "patches of {side} pixels in {columns} columns do not match observations of {pixels} pixels"
            );
        }
    }
    Ok(())
}

/// Refuses widths of 0 and widths that no memory could hold, before anything is computed from them.
pub(super) fn check_widths<'a>(widths: impl IntoIterator<Item = &'a usize>) -> anyhow::Result<()> {
    for &width in widths {
        ensure!((1..=1 << 24).contains(&width), "a width of {width}");
    }
    Ok(())
}
