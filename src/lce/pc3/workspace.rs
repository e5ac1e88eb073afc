//! One step of PC3's loss: terms and gradient for a batch.

use super::{
    losses::{Columns, noise_width},
    nce::{Nce, PairWeights},
    settings::{Pc3Loss, Pc3Terms},
};
use crate::{
    lce::{
        curvature::Curvature,
        model::LceModel,
        passes::{Passes, PerSample},
        transition_batch::{Pass, Step, TransitionBatch},
    },
    nn::columns::{Block, over_samples},
    num::Real,
};

/// Computes PC3's loss for batches up to a size. It keeps its buffers, so that a step allocates nothing.
#[derive(Debug, Clone)]
pub struct Pc3Workspace<T> {
    passes: Passes<T>,
    curvature: Curvature<T>,
    nce: Nce<T>,
    next: Block<T>,
    d_next: Block<T>,
    /// The mean of E(x) over the batch.
    center: Vec<T>,
    terms: Vec<Pc3Terms<T>>,
}

impl<T: Real> Pc3Workspace<T> {
    /// Buffers for up to `samples` samples.
    pub fn new(model: &LceModel<T>, samples: usize) -> Self {
        let n = model.sizes.latent;
        Self {
            passes: Passes::new(model, samples, PerSample { decoded: 0, predicted: 1 }),
            curvature: Curvature::new(&model.nets, samples),
            nce: Nce::new(n, samples),
            next: Block::new(n, samples),
            d_next: Block::new(n, samples),
            center: vec![T::ZERO; n],
            terms: vec![Pc3Terms::default(); samples],
        }
    }

    /// How many standard normal numbers a sample of this model needs.
    pub fn noise_width(model: &LceModel<T>) -> usize {
        noise_width(model.sizes.latent, model.sizes.action)
    }

    /// The largest batch that the buffers hold.
    pub fn capacity(&self) -> usize {
        self.terms.len()
    }

    /// The gradient of the last step. It is zero for the parameters of D and B.
    pub fn gradient(&self) -> &[T] {
        &self.passes.gradient
    }

    /// Computes the gradient of PC3's loss over a batch, and returns the means of its terms.
    pub fn step(
        &mut self,
        threads: usize,
        model: &LceModel<T>,
        loss: &Pc3Loss,
        batch: &TransitionBatch<'_, T>,
    ) -> Pc3Terms {
        let samples = batch.pairs.len() / 2;
        let step = Step { model, loss, batch, mean: T::of(1.0 / samples as f64) };
        self.passes.pack(model, batch.images, false);
        over_samples(threads, 0, samples, self.view(samples), &|first, samples, columns| {
            Pass { step: &step, first, samples, c: columns }.forward();
        });
        self.compare(&step, samples);
        let center = std::mem::take(&mut self.center);
        over_samples(threads, 0, samples, self.view(samples), &|first, samples, columns| {
            Pass { step: &step, first, samples, c: columns }.backward(&center);
        });
        self.center = center;
        self.passes.weight_gradients(threads, model, (batch.images, batch.pairs), false);
        self.curvature.view(samples).add_gradient(&model.nets, &mut self.passes.gradient);
        let squared = self.center.iter().map(|&z| z.f64() * z.f64()).sum();
        Pc3Terms { center: squared, ..Pc3Terms::mean(&self.terms[..samples]) }
    }

    /// Evaluates what concerns all samples together: NCE with the consistency, and the mean of E(x).
    fn compare(&mut self, step: &Step<'_, Pc3Loss, T>, samples: usize) {
        let n = step.model.sizes.latent;
        let Self { passes, nce, next, d_next, center, terms, .. } = self;
        let mut nets = passes.view(samples);
        center.fill(T::ZERO);
        for z_u in nets.dynamics_input.data.chunks_exact(n + step.model.sizes.action) {
            center.iter_mut().zip(z_u).for_each(|(sum, &z)| *sum += z);
        }
        center.iter_mut().for_each(|sum| *sum *= step.mean);
        let weights = [step.loss.nce, step.loss.consistency].map(|weight| T::of(weight) * step.mean);
        let weights = PairWeights { nce: weights[0], consistency: weights[1] };
        let (gaussians, d_gaussians) = nets.dynamics.output_and_delta();
        let next = (&*next.view(samples).data, &mut *d_next.view(samples).data);
        nce.run(next, (gaussians, d_gaussians), n, weights, |i, pair| {
            (terms[i].nce, terms[i].consistency) = (pair.nce, -pair.log_density);
        });
    }

    /// The first `samples` samples.
    fn view(&mut self, samples: usize) -> Columns<'_, T> {
        Columns {
            nets: self.passes.view(samples),
            curvature: self.curvature.view(samples),
            next: self.next.view(samples),
            d_next: self.d_next.view(samples),
            terms: &mut self.terms[..samples],
        }
    }
}
