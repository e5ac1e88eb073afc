//! The loss's buffers.

use super::terms::Terms;
use crate::{
    lce::{
        backward::{BackwardColumns, BackwardPass},
        curvature::{Curvature, CurvatureColumns},
        model::LceModel,
        passes::{PassColumns, Passes, PerSample},
    },
    nn::columns::{Block, BlockMut, cut_together},
    num::Real,
};

/// Buffers for a batch.
#[derive(Debug, Clone)]
pub(super) struct Buffers<T> {
    pub(super) nets: Passes<T>,
    pub(super) backward: BackwardPass<T>,
    pub(super) curvature: Curvature<T>,
    pub(super) z1: Block<T>,
    d_z1: Block<T>,
    pub(super) terms: Vec<Terms<T>>,
}

cut_together! {
    /// Some samples of [`Buffers`].
    pub(super) struct Columns<'a, T> {
        pub(super) nets: PassColumns<'a, T>,
        pub(super) backward: BackwardColumns<'a, T>,
        pub(super) curvature: CurvatureColumns<'a, T>,
        pub(super) z1: BlockMut<'a, T>,
        pub(super) d_z1: BlockMut<'a, T>,
        pub(super) terms: &'a mut [Terms<T>],
    }
}

impl<T: Real> Buffers<T> {
    /// Buffers for up to `samples` samples.
    pub(super) fn new(model: &LceModel<T>, samples: usize) -> Self {
        let (nets, n) = (&model.nets, model.sizes.latent);
        Self {
            nets: Passes::new(model, samples, PerSample { decoded: 3, predicted: 2 }),
            backward: BackwardPass::new(&nets.backward, samples),
            curvature: Curvature::new(nets, samples),
            z1: Block::new(n, samples),
            d_z1: Block::new(n, samples),
            terms: vec![Terms::default(); samples],
        }
    }

    /// The first `samples` samples.
    pub(super) fn view(&mut self, samples: usize) -> Columns<'_, T> {
        Columns {
            nets: self.nets.view(samples),
            backward: self.backward.view(samples),
            curvature: self.curvature.view(samples),
            z1: self.z1.view(samples),
            d_z1: self.d_z1.view(samples),
            terms: &mut self.terms[..samples],
        }
    }
}
