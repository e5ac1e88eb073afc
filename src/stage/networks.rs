//! Widths of the networks that learn a task.

use super::StageCx;
use crate::{
    env::{Frames, NetworkSizes, Spec, Task},
    lce::{BackwardSizes, ImageNetworks, PassiveDynamics, Sizes},
};

impl StageCx<'_> {
    /// How many frames the task stacks in one observation.
    pub(super) fn frames_of_observation(&self) -> usize {
        self.task.spec().frames.count
    }
}

/// The networks that the paper's appendix gives for a task.
pub fn network_sizes(task: &Task) -> Sizes {
    let NetworkSizes { latent, is_convolutional, encoder, decoder, dynamics, backward } = *task.networks();
    let Spec { frames: Frames { height: rows, width: columns, count: frames }, action_limit, .. } = task.spec();
    Sizes {
        pixels: frames * rows * columns,
        latent,
        action: action_limit.len(),
        images: match is_convolutional {
            true => ImageNetworks::Convolutional { frames, rows, columns },
            false => ImageNetworks::Dense,
        },
        encoder,
        decoder,
        dynamics,
        backward: BackwardSizes {
            z: backward.latent,
            u: backward.action,
            x: backward.observation,
            joint: backward.joint,
        },
        jacobian_heads: false,
        locally_linear: false,
        passive_dynamics: PassiveDynamics::None,
    }
}
