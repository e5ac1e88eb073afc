//! The networks of a new model.

use super::params::{Networks, Params, Slopes};
use crate::{
    artifact::{TrainedModel, Transitions},
    lce::{BackwardSizes, ImageNetworks, LceModel, Sizes, model::background},
    nn::{adam::Adam, binary_images::PooledPatches},
    num::rng::Rng,
};

/// A model with random weights.
pub(super) fn random_model(
    params: &Params,
    transitions: &Transitions,
    mut sizes: Sizes,
    rng: &mut Rng,
) -> anyhow::Result<TrainedModel> {
    sizes.jacobian_heads = params.slopes == Slopes::Amortized;
    if let Networks::PooledPatches(patches) = params.networks {
        let ((rows, columns), side) = (transitions.picture, patches.side as usize);
        anyhow::ensure!(
            rows % side == 0 && columns % side == 0,
            "pictures of {rows} x {columns} pixels cannot be cut into patches of {side} x {side}: change \
             `networks.pooled_patches.side`"
        );
        let images = ImageNetworks::Patches(PooledPatches { columns, side });
        let (hidden, backward) = ([128; 2], BackwardSizes { z: 10, u: 10, x: 50, joint: 100 });
        sizes = Sizes { images, encoder: hidden, decoder: hidden, backward, ..sizes };
    }
    let background = background(&transitions.frames(), transitions.pixels());
    let model = LceModel::new(sizes, background, rng);
    let adam = Adam::new(model.arena.len());
    Ok(TrainedModel { model, adam, suspect_goals: Vec::new() })
}
