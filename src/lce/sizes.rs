//! Widths of an LCE model's networks.

use super::{
    passive_dynamics::PassiveDynamics,
    shared_frames::{Differences, SharedFrames, Speeds},
};
use crate::nn::binary_images::{Likelihood, PooledPatches};

/// Channels between two convolutions (paper, "Network Architectures").
pub(super) const CHANNELS: usize = 32;

/// How encoder, decoder and backward dynamics see observations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ImageNetworks {
    /// Fully connected networks read and predict every pixel.
    Dense,
    /// Encoder and decoder are convolutional; an observation is `frames` images of `rows` x `columns` pixels.
    Convolutional {
        /// Images of an observation.
        frames: usize,
        /// Rows of an image.
        rows: usize,
        /// Columns of an image.
        columns: usize,
    },
    /// Fully connected networks read and predict how much of each patch of pixels is lit.
    Patches(PooledPatches),
    /// One fully connected network reads every frame of an observation, as patches.
    SharedFrames(SharedFrames),
}

/// Widths of the backward dynamics' layers (paper, "Backwards dynamical model").
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BackwardSizes {
    /// N_z, the layer that reads z'.
    pub z: usize,
    /// N_u, the layer that reads the action.
    pub u: usize,
    /// N_x, the layer that reads the observation.
    pub x: usize,
    /// N_joint, the layer that reads these three.
    pub joint: usize,
}

/// Widths of all networks (paper, "Network Architectures").
#[derive(Debug, Clone, PartialEq)]
pub struct Sizes {
    /// Pixels of an observation x.
    pub pixels: usize,
    /// How the decoder predicts shades; `None` where every pixel is lit or not.
    pub shades: Option<Likelihood>,
    /// Dimension of the latent space.
    pub latent: usize,
    /// Components of an action.
    pub action: usize,
    /// How networks see observations.
    pub images: ImageNetworks,
    /// Hidden layers of the encoder. In a convolutional encoder the first is the convolutions' output.
    pub encoder: [usize; 2],
    /// Hidden layers of the decoder. In a convolutional decoder the last is the convolutions' input.
    pub decoder: [usize; 2],
    /// Hidden layers of the dynamics.
    pub dynamics: [usize; 2],
    /// Layers of the backward dynamics.
    pub backward: BackwardSizes,
    /// Whether F has heads for its own Jacobians (PCC, "amortized").
    pub jacobian_heads: bool,
    /// Whether F is a locally linear transition (E2C). Then it has no other heads.
    pub locally_linear: bool,
    /// How the anchor's codes move without an action.
    pub passive_dynamics: PassiveDynamics,
}

/// Networks for unit tests, with the widths of the four tasks.
#[cfg(test)]
impl Sizes {
    /// The paper's sizes for the planar system.
    pub fn planar() -> Self {
        Self {
            pixels: 1600,
            shades: None,
            latent: 2,
            action: 2,
            images: ImageNetworks::Dense,
            encoder: [300, 300],
            decoder: [300, 300],
            dynamics: [20, 20],
            backward: BackwardSizes { z: 5, u: 5, x: 100, joint: 100 },
            jacobian_heads: false,
            locally_linear: false,
            passive_dynamics: PassiveDynamics::None,
        }
    }

    /// The paper's sizes for the pendulum's swing-up.
    pub fn swing_up() -> Self {
        Self {
            pixels: 2 * 48 * 48,
            shades: None,
            latent: 3,
            action: 1,
            images: ImageNetworks::Dense,
            encoder: [500, 500],
            decoder: [500, 500],
            dynamics: [30, 30],
            backward: BackwardSizes { z: 10, u: 10, x: 200, joint: 200 },
            jacobian_heads: false,
            locally_linear: false,
            passive_dynamics: PassiveDynamics::None,
        }
    }

    /// The paper's sizes for balancing the cart-pole.
    pub fn cart_pole() -> Self {
        Self {
            pixels: 2 * 80 * 80,
            shades: None,
            latent: 8,
            action: 1,
            images: ImageNetworks::Convolutional { frames: 2, rows: 80, columns: 80 },
            encoder: [1000, 200],
            decoder: [200, 1000],
            dynamics: [40, 40],
            backward: BackwardSizes { z: 10, u: 10, x: 300, joint: 300 },
            jacobian_heads: false,
            locally_linear: false,
            passive_dynamics: PassiveDynamics::None,
        }
    }

    /// The paper's sizes for the three-link pendulum.
    pub fn three_pole() -> Self {
        let backward = BackwardSizes { z: 10, u: 10, x: 400, joint: 400 };
        Self { action: 3, encoder: [1000, 500], backward, ..Self::cart_pole() }
    }
}

impl Sizes {
    /// The patches that networks read instead of pixels, if any.
    pub fn read_patches(&self) -> Option<PooledPatches> {
        match self.images {
            ImageNetworks::Patches(patches) => Some(patches),
            ImageNetworks::SharedFrames(frames) => Some(frames.read),
            ImageNetworks::Dense | ImageNetworks::Convolutional { .. } => None,
        }
    }

    /// The patches that the decoder predicts instead of pixels, if any.
    pub fn predicted_patches(&self) -> Option<PooledPatches> {
        match self.images {
            ImageNetworks::SharedFrames(frames) => Some(frames.predicted),
            _ => self.read_patches(),
        }
    }

    /// The form of codes that hold speeds; `None` if codes hold none.
    pub fn speeds(&self) -> Option<Speeds> {
        match self.images {
            ImageNetworks::SharedFrames(SharedFrames {
                coordinates,
                differences: Differences::Scaled { scale },
                ..
            }) => Some(Speeds { positions: coordinates, scale }),
            _ => None,
        }
    }

    /// Inputs of the networks for one observation: the number of its pixels, or of the patches that are read.
    pub fn entries(&self) -> usize {
        self.pixels / self.read_patches().map_or(1, PooledPatches::area)
    }

    /// Logits of the decoder for one observation: one for each pixel, or for each patch that is predicted.
    pub fn predicted_entries(&self) -> usize {
        self.pixels / self.predicted_patches().map_or(1, PooledPatches::area)
    }
}
