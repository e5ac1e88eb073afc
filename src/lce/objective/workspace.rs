//! Buffers of the loss, and one step: terms and gradient for a batch.

use super::{
    batch::Batch,
    pass::{Pass, Step},
    terms::{Terms, Weights},
};
use crate::{
    lce::{
        backward::{BackwardColumns, BackwardPass},
        curvature::{Curvature, CurvatureColumns},
        model::LceModel,
        passes::{PassColumns, Passes, PerSample},
    },
    nn::columns::{Block, BlockMut, cut_together, over_samples},
    num::Real,
};

/// Buffers for batches up to a size, so that a step allocates nothing.
#[derive(Debug, Clone)]
pub struct Workspace<T> {
    passes: Passes<T>,
    backward: BackwardPass<T>,
    curvature: Curvature<T>,
    z1: Block<T>,
    d_z1: Block<T>,
    terms: Vec<Terms<T>>,
}

cut_together! {
    /// Some samples of a [`Workspace`].
    pub(super) struct Columns<'a, T> {
        pub(super) nets: PassColumns<'a, T>,
        pub(super) backward: BackwardColumns<'a, T>,
        pub(super) curvature: CurvatureColumns<'a, T>,
        pub(super) z1: BlockMut<'a, T>,
        pub(super) d_z1: BlockMut<'a, T>,
        pub(super) terms: &'a mut [Terms<T>],
    }
}

impl<T: Real> Workspace<T> {
    /// Buffers for up to `samples` samples.
    pub fn new(model: &LceModel<T>, samples: usize) -> Self {
        let (nets, n) = (&model.nets, model.sizes.latent);
        Self {
            passes: Passes::new(model, samples, PerSample { decoded: 3, predicted: 2 }),
            backward: BackwardPass::new(&nets.backward, samples),
            curvature: Curvature::new(nets, samples),
            z1: Block::new(n, samples),
            d_z1: Block::new(n, samples),
            terms: vec![Terms::default(); samples],
        }
    }

    fn view(&mut self, samples: usize) -> Columns<'_, T> {
        Columns {
            nets: self.passes.view(samples),
            backward: self.backward.view(samples),
            curvature: self.curvature.view(samples),
            z1: self.z1.view(samples),
            d_z1: self.d_z1.view(samples),
            terms: &mut self.terms[..samples],
        }
    }

    /// The gradient of the last step.
    pub fn gradient(&self) -> &[T] {
        &self.passes.gradient
    }

    /// The terms of one sample of the last step.
    pub fn sample_terms(&self, sample: usize) -> Terms {
        self.terms[sample].map(T::f64)
    }

    /// Computes the gradient of the weighted loss over a batch, and returns the means of its terms.
    pub fn step(&mut self, threads: usize, model: &LceModel<T>, weights: &Weights, batch: &Batch<'_, T>) -> Terms {
        let samples = batch.x.len();
        self.passes.pack(model, batch.images, true);
        self.backward.pack(&model.arena, batch.images);
        let step = Step { model, weights, batch, mean: T::of(1.0 / samples as f64) };
        over_samples(threads, 0, samples, self.view(samples), &|first, samples, columns| {
            Pass { step: &step, first, samples, c: columns }.run();
        });
        self.weight_gradients(threads, model, batch);
        Terms::mean(&self.terms[..samples])
    }

    fn weight_gradients(&mut self, threads: usize, model: &LceModel<T>, batch: &Batch<'_, T>) {
        let (nets, samples) = (&model.nets, batch.x.len());
        self.passes.weight_gradients(threads, model, (batch.images, batch.pairs), true);
        let gradient = &mut self.passes.gradient[..];
        let z1 = &*self.z1.view(samples).data;
        self.backward.gradient(threads, gradient, (z1, batch.actions), (batch.images, batch.x), samples);
        self.curvature.view(samples).add_gradient(nets, gradient);
    }
}
