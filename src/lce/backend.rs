//! What computes a training step: loss terms and gradient for a batch.

use super::{
    model::LceModel,
    objective::{Batch, Terms, Weights, Workspace},
    warm_up::{WarmUp, WarmUpBatch, WarmUpTerms, WarmUpWorkspace},
};
use crate::num::Real;

/// Samples of a batch (paper, "Training Hyper-Parameters").
pub const BATCH: usize = 128;

/// A loss's terms, averaged over a batch, and the gradient of all parameters in the order of the model's arena.
#[derive(Debug, Clone, Copy)]
pub struct TermsAndGradient<'a, Terms, T> {
    /// The terms.
    pub terms: Terms,
    /// The gradient of the weighted loss.
    pub gradient: &'a [T],
}

/// Computes training steps of an LCE model for batches of up to [`BATCH`] samples. The trainer draws noise and steps
/// Adam.
///
/// The same batch must always give the same bits, for any number of threads.
pub trait TrainingBackend<T>: std::fmt::Debug + Send {
    /// The numeric platform: two back ends with the same name compute the same bits. It belongs to the key of a node
    /// that trains with this back end.
    fn platform(&self) -> &'static str;

    /// Terms and gradient of the loss.
    fn loss(
        &mut self,
        threads: usize,
        model: &LceModel<T>,
        weights: &Weights,
        batch: &Batch<'_, T>,
    ) -> TermsAndGradient<'_, Terms, T>;

    /// Terms and gradient of the warm-up loss.
    fn warm_up(
        &mut self,
        threads: usize,
        model: &LceModel<T>,
        settings: &WarmUp,
        batch: &WarmUpBatch<'_, T>,
    ) -> TermsAndGradient<'_, WarmUpTerms, T>;
}

/// The back end that runs on this machine's cores.
///
/// It keeps the buffers of the loss it was last asked for. Both losses' buffers together would take much memory.
#[derive(Debug, Clone)]
pub struct Cpu<T> {
    loss: Option<Workspace<T>>,
    warm_up: Option<WarmUpWorkspace<T>>,
}

impl Cpu<f32> {
    /// The platform's name. Raise its number when the same batch would give other bits.
    pub const PLATFORM: &'static str = "x86_64-fma-1";
}

impl<T> Default for Cpu<T> {
    fn default() -> Self {
        Self { loss: None, warm_up: None }
    }
}

impl<T: Real> TrainingBackend<T> for Cpu<T> {
    fn platform(&self) -> &'static str {
        Cpu::PLATFORM
    }

    fn loss(
        &mut self,
        threads: usize,
        model: &LceModel<T>,
        weights: &Weights,
        batch: &Batch<'_, T>,
    ) -> TermsAndGradient<'_, Terms, T> {
        self.warm_up = None;
        let workspace = self.loss.get_or_insert_with(|| Workspace::new(model, BATCH));
        let terms = workspace.step(threads, model, weights, batch);
        TermsAndGradient { terms, gradient: workspace.gradient() }
    }

    fn warm_up(
        &mut self,
        threads: usize,
        model: &LceModel<T>,
        settings: &WarmUp,
        batch: &WarmUpBatch<'_, T>,
    ) -> TermsAndGradient<'_, WarmUpTerms, T> {
        self.loss = None;
        let workspace = self.warm_up.get_or_insert_with(|| WarmUpWorkspace::new(model, BATCH));
        let terms = workspace.step(threads, model, settings, batch);
        TermsAndGradient { terms, gradient: workspace.gradient() }
    }
}
