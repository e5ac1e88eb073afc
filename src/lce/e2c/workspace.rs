//! One step of E2C's loss: terms and gradient for a batch.

use super::{
    losses::Columns,
    settings::{E2cLoss, E2cTerms},
};
use crate::{
    lce::{
        model::LceModel,
        passes::{Passes, PerSample},
        transition_batch::{Pass, Step, TransitionBatch},
    },
    nn::columns::{Block, over_samples},
    num::Real,
};

/// Computes E2C's loss for batches up to a size, of a model with a locally linear F. It keeps its buffers, so that a step
/// allocates nothing.
#[derive(Debug, Clone)]
pub struct E2cWorkspace<T> {
    passes: Passes<T>,
    scratch: Block<T>,
    terms: Vec<E2cTerms<T>>,
}

impl<T: Real> E2cWorkspace<T> {
    /// Buffers for up to `samples` samples.
    pub fn new(model: &LceModel<T>, samples: usize) -> Self {
        Self {
            passes: Passes::new(model, samples, PerSample { decoded: 2, predicted: 1 }),
            scratch: Block::new(model.sizes.latent, samples),
            terms: vec![E2cTerms::default(); samples],
        }
    }

    /// How many standard normal numbers a sample of this model needs.
    pub fn noise_width(model: &LceModel<T>) -> usize {
        model.sizes.latent
    }

    /// The gradient of the last step. It is zero for B's parameters.
    pub fn gradient(&self) -> &[T] {
        &self.passes.gradient
    }

    /// Computes the gradient of E2C's loss over a batch, and returns the means of its terms.
    pub fn step(
        &mut self,
        threads: usize,
        model: &LceModel<T>,
        loss: &E2cLoss,
        batch: &TransitionBatch<'_, T>,
    ) -> E2cTerms {
        let samples = batch.pairs.len() / 2;
        self.passes.pack(model, batch.images, true);
        let columns = Columns {
            nets: self.passes.view(samples),
            scratch: self.scratch.view(samples),
            terms: &mut self.terms[..samples],
        };
        let step = Step { model, loss, batch, mean: T::of(1.0 / samples as f64) };
        over_samples(threads, 0, samples, columns, &|first, samples, columns| {
            Pass { step: &step, first, samples, c: columns }.run();
        });
        self.passes.weight_gradients(threads, model, (batch.images, batch.pairs), true);
        E2cTerms::mean(&self.terms[..samples])
    }
}
