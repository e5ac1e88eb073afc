//! One step of the loss: terms and gradient for a batch.

use super::{
    batch::Batch,
    columns::Buffers,
    pass::{Pass, Step},
    terms::{Terms, Weights},
};
use crate::{lce::model::LceModel, nn::columns::over_samples, num::Real};

/// Computes the loss for batches up to a size. It keeps its buffers, so that a step allocates nothing.
#[derive(Debug, Clone)]
pub struct Workspace<T> {
    buffers: Buffers<T>,
}

impl<T: Real> Workspace<T> {
    /// Buffers for up to `samples` samples.
    pub fn new(model: &LceModel<T>, samples: usize) -> Self {
        Self { buffers: Buffers::new(model, samples) }
    }

    /// The gradient of the last step.
    pub fn gradient(&self) -> &[T] {
        &self.buffers.nets.gradient
    }

    /// The terms of one sample of the last step.
    pub fn sample_terms(&self, sample: usize) -> Terms {
        self.buffers.terms[sample].map(T::f64)
    }

    /// Computes the gradient of the weighted loss over a batch, and returns the means of its terms.
    pub fn step(&mut self, threads: usize, model: &LceModel<T>, weights: &Weights, batch: &Batch<'_, T>) -> Terms {
        let samples = batch.x.len();
        self.buffers.nets.pack(model, batch.images, true);
        self.buffers.backward.pack(&model.arena, batch.images);
        let step = Step { model, weights, batch, mean: T::of(1.0 / samples as f64) };
        over_samples(threads, 0, samples, self.buffers.view(samples), &|first, samples, columns| {
            Pass { step: &step, first, samples, c: columns }.run();
        });
        self.weight_gradients(threads, model, batch);
        Terms::mean(&self.buffers.terms[..samples])
    }

    fn weight_gradients(&mut self, threads: usize, model: &LceModel<T>, batch: &Batch<'_, T>) {
        let samples = batch.x.len();
        let Buffers { nets, backward, curvature, z1, .. } = &mut self.buffers;
        nets.weight_gradients(threads, model, (batch.images, batch.pairs), true);
        let (gradient, z1) = (&mut nets.gradient[..], &*z1.view(samples).data);
        backward.gradient(threads, gradient, (z1, batch.actions), (batch.images, batch.x), samples);
        curvature.view(samples).add_gradient(&model.nets, gradient);
    }
}
