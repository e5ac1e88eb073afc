//! What computes a training step: loss terms and gradient for a batch.

use super::{
    e2c::{E2cLoss, E2cTerms, E2cWorkspace},
    model::LceModel,
    objective::{Batch, Terms, Weights, Workspace},
    pc3::{Pc3Loss, Pc3Terms, Pc3Workspace},
    rce::{RceLoss, RceTerms, RceWorkspace},
    transition_batch::TransitionBatch,
    warm_up::{WarmUp, WarmUpBatch, WarmUpTerms, WarmUpWorkspace},
};
use crate::num::Real;

/// Samples of a batch (paper, "Training Hyper-Parameters"). PC3 has a batch size of its own.
pub const BATCH: usize = 128;

/// A loss's terms, averaged over a batch, and the gradient of all parameters in the order of the model's arena.
#[derive(Debug, Clone, Copy)]
pub struct TermsAndGradient<'a, Terms, T> {
    /// The terms.
    pub terms: Terms,
    /// The gradient of the weighted loss.
    pub gradient: &'a [T],
}

/// Computes training steps of an LCE model for batches of up to [`BATCH`] samples, where nothing else is said. The trainer
/// draws noise and steps Adam.
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

    /// Terms and gradient of PC3's loss, for a batch of any size.
    fn pc3(
        &mut self,
        threads: usize,
        model: &LceModel<T>,
        loss: &Pc3Loss,
        batch: &TransitionBatch<'_, T>,
    ) -> TermsAndGradient<'_, Pc3Terms, T>;

    /// Terms and gradient of E2C's loss, of a model with a locally linear F.
    fn e2c(
        &mut self,
        threads: usize,
        model: &LceModel<T>,
        loss: &E2cLoss,
        batch: &TransitionBatch<'_, T>,
    ) -> TermsAndGradient<'_, E2cTerms, T>;

    /// Terms and gradient of RCE's loss, of a model with a locally linear F.
    fn rce(
        &mut self,
        threads: usize,
        model: &LceModel<T>,
        loss: &RceLoss,
        batch: &TransitionBatch<'_, T>,
    ) -> TermsAndGradient<'_, RceTerms, T>;
}

/// The back end that runs on this machine's cores.
///
/// It keeps the buffers of the loss it was last asked for. The buffers of all losses together would take much memory.
#[derive(Debug, Clone)]
pub struct Cpu<T> {
    loss: Option<Workspace<T>>,
    warm_up: Option<WarmUpWorkspace<T>>,
    pc3: Option<Pc3Workspace<T>>,
    e2c: Option<E2cWorkspace<T>>,
    rce: Option<RceWorkspace<T>>,
}

impl Cpu<f32> {
    /// The platform's name. Raise its number when the same batch would give other bits.
    pub const PLATFORM: &'static str = "x86_64-fma-1";
}

impl<T> Default for Cpu<T> {
    fn default() -> Self {
        Self { loss: None, warm_up: None, pc3: None, e2c: None, rce: None }
    }
}

impl<T: Real> Cpu<T> {
    /// The buffers of one loss: those that are kept if they are `enough`, or `new` ones. The buffers of all other losses go.
    fn only<W>(
        &mut self,
        buffers: fn(&mut Self) -> &mut Option<W>,
        enough: impl FnOnce(&W) -> bool,
        new: impl FnOnce() -> W,
    ) -> &mut W {
        let kept = buffers(self).take().filter(enough);
        *self = Self::default();
        buffers(self).insert(kept.unwrap_or_else(new))
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
        let workspace = self.only(|cpu| &mut cpu.loss, |_| true, || Workspace::new(model, BATCH));
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
        let workspace = self.only(|cpu| &mut cpu.warm_up, |_| true, || WarmUpWorkspace::new(model, BATCH));
        let terms = workspace.step(threads, model, settings, batch);
        TermsAndGradient { terms, gradient: workspace.gradient() }
    }

    fn pc3(
        &mut self,
        threads: usize,
        model: &LceModel<T>,
        loss: &Pc3Loss,
        batch: &TransitionBatch<'_, T>,
    ) -> TermsAndGradient<'_, Pc3Terms, T> {
        let samples = batch.pairs.len() / 2;
        let enough = |kept: &Pc3Workspace<T>| kept.capacity() >= samples;
        let workspace = self.only(|cpu| &mut cpu.pc3, enough, || Pc3Workspace::new(model, samples));
        let terms = workspace.step(threads, model, loss, batch);
        TermsAndGradient { terms, gradient: workspace.gradient() }
    }

    fn e2c(
        &mut self,
        threads: usize,
        model: &LceModel<T>,
        loss: &E2cLoss,
        batch: &TransitionBatch<'_, T>,
    ) -> TermsAndGradient<'_, E2cTerms, T> {
        let workspace = self.only(|cpu| &mut cpu.e2c, |_| true, || E2cWorkspace::new(model, BATCH));
        let terms = workspace.step(threads, model, loss, batch);
        TermsAndGradient { terms, gradient: workspace.gradient() }
    }

    fn rce(
        &mut self,
        threads: usize,
        model: &LceModel<T>,
        loss: &RceLoss,
        batch: &TransitionBatch<'_, T>,
    ) -> TermsAndGradient<'_, RceTerms, T> {
        let workspace = self.only(|cpu| &mut cpu.rce, |_| true, || RceWorkspace::new(model, BATCH));
        let terms = workspace.step(threads, model, loss, batch);
        TermsAndGradient { terms, gradient: workspace.gradient() }
    }
}
