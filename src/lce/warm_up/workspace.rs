//! One step of the warm-up: terms and gradient for a batch.

use super::{
    columns::Columns,
    losses::{Pass, Step},
    settings::{WarmUp, WarmUpBatch, WarmUpTerms},
};
use crate::{
    lce::{
        model::LceModel,
        passes::{Passes, PerSample},
    },
    nn::columns::over_samples,
    num::Real,
};

/// Computes the warm-up loss for batches up to a size. It keeps its buffers, so that a step allocates nothing.
#[derive(Debug, Clone)]
pub struct WarmUpWorkspace<T> {
    passes: Passes<T>,
    terms: Vec<WarmUpTerms<T>>,
}

impl<T: Real> WarmUpWorkspace<T> {
    /// Buffers for up to `samples` samples.
    pub fn new(model: &LceModel<T>, samples: usize) -> Self {
        let passes = Passes::new(model, samples, PerSample { decoded: 2, predicted: 1 });
        Self { passes, terms: vec![WarmUpTerms::default(); samples] }
    }

    /// The gradient of the last step. It is zero for B's parameters.
    pub fn gradient(&self) -> &[T] {
        &self.passes.gradient
    }

    /// Computes the gradient of the warm-up loss over a batch, and returns the means of its terms.
    pub fn step(
        &mut self,
        threads: usize,
        model: &LceModel<T>,
        settings: &WarmUp,
        batch: &WarmUpBatch<'_, T>,
    ) -> WarmUpTerms {
        let samples = batch.pairs.len() / 2;
        self.passes.pack(model, batch.images, batch.decode);
        let columns = Columns { nets: self.passes.view(samples), terms: &mut self.terms[..samples] };
        let step = Step { model, settings, batch, mean: T::of(1.0 / samples as f64) };
        over_samples(threads, 0, samples, columns, &|first, samples, columns| {
            Pass { step: &step, first, samples, c: columns }.run();
        });
        self.passes.weight_gradients(threads, model, (batch.images, batch.pairs), batch.decode);
        WarmUpTerms::mean(&self.terms[..samples])
    }
}
