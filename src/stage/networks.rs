//! Widths of the networks that learn a task.

use super::StageCx;
use crate::{
    env::{Frames, NetworkSizes, Spec, Task},
    lce::{BackwardSizes, ImageNetworks, PassiveDynamics, Sizes},
    nn::binary_images::Likelihood,
    record::At,
};

impl StageCx<'_> {
    /// How many frames the task stacks in one observation.
    pub(super) fn frames_of_observation(&self) -> usize {
        self.task.spec().frames.count
    }

    /// Records an observation of the task.
    pub(super) fn picture(&mut self, topic: &'static str, at: At, observation: &[u8]) {
        let (rows, columns, bytes) = self.task.spec().frames.picture(observation);
        self.record.picture(topic, at, rows as u32, columns as u32, &bytes);
    }
}

/// The networks that the paper's appendix gives for a task.
pub fn network_sizes(task: &Task) -> Sizes {
    let NetworkSizes { latent, is_convolutional, encoder, decoder, dynamics, backward } = task.networks();
    let Spec { frames, action_limit, .. } = task.spec();
    let Frames { height: rows, width: columns, channels, shades, count } = frames;
    Sizes {
        pixels: count * frames.pixels(),
        shades: shades.then(Likelihood::default),
        latent,
        action: action_limit.len(),
        images: match is_convolutional {
            true => ImageNetworks::Convolutional { frames: count * channels, rows, columns },
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
