//! One step of RCE's loss: terms and gradient for a batch.

use super::{
    losses::Columns,
    settings::{RceLoss, RceTerms},
};
use crate::{
    lce::{
        backward::BackwardPass,
        model::LceModel,
        passes::{Passes, PerSample},
        transition_batch::{Pass, Step, TransitionBatch},
    },
    nn::columns::{Block, over_samples},
    num::Real,
};

/// Computes RCE's loss for batches up to a size, of a model with a locally linear F. It keeps its buffers, so that a step
/// allocates nothing.
#[derive(Debug, Clone)]
pub struct RceWorkspace<T> {
    passes: Passes<T>,
    pub(super) backward: BackwardPass<T>,
    d_next: Block<T>,
    scratch: Block<T>,
    pub(super) terms: Vec<RceTerms<T>>,
}

impl<T: Real> RceWorkspace<T> {
    /// Buffers for up to `samples` samples.
    pub fn new(model: &LceModel<T>, samples: usize) -> Self {
        let n = model.sizes.latent;
        Self {
            passes: Passes::new(model, samples, PerSample { decoded: 1, predicted: 1 }),
            backward: BackwardPass::new(&model.nets.backward, samples),
            d_next: Block::new(n, samples),
            scratch: Block::new(2 * n, samples),
            terms: vec![RceTerms::default(); samples],
        }
    }

    /// How many standard normal numbers a sample of this model needs: for z', and for the transition's point.
    pub fn noise_width(model: &LceModel<T>) -> usize {
        2 * model.sizes.latent
    }

    /// The gradient of the last step.
    pub fn gradient(&self) -> &[T] {
        &self.passes.gradient
    }

    /// Computes the gradient of RCE's loss over a batch, and returns the means of its terms.
    pub fn step(
        &mut self,
        threads: usize,
        model: &LceModel<T>,
        loss: &RceLoss,
        batch: &TransitionBatch<'_, T>,
    ) -> RceTerms {
        let samples = batch.pairs.len() / 2;
        self.passes.pack(model, batch.images, true);
        self.backward.pack(&model.arena, batch.images);
        let columns = Columns {
            nets: self.passes.view(samples),
            backward: self.backward.view(samples),
            d_next: self.d_next.view(samples),
            scratch: self.scratch.view(samples),
            terms: &mut self.terms[..samples],
        };
        let step = Step { model, loss, batch, mean: T::of(1.0 / samples as f64) };
        over_samples(threads, 0, samples, columns, &|first, samples, columns| {
            Pass { step: &step, first, samples, c: columns }.run();
        });
        self.passes.weight_gradients(threads, model, (batch.images, batch.pairs), true);
        let Self { passes, backward, .. } = self;
        let next = &*passes.decoder_input.view(samples).data;
        backward.gradient(threads, &mut passes.gradient, (next, batch.actions), (batch.images, batch.x), samples);
        RceTerms::mean(&self.terms[..samples])
    }
}
