//! Forward and backward through the networks of PC3 for some samples of a batch, with one function for every term but
//! NCE, which needs all samples.

use super::settings::{Pc3Loss, Pc3Terms};
use crate::{
    lce::{curvature::CurvatureColumns, gaussian_pair::GaussianPair, passes::PassColumns, transition_batch::Pass},
    nn::columns::{BlockMut, cut_together},
    num::{Real, simd::vectorize},
};

cut_together! {
    /// Networks, codes and terms of some samples.
    pub(super) struct Columns<'a, T> {
        pub(super) nets: PassColumns<'a, T>,
        pub(super) curvature: CurvatureColumns<'a, T>,
        pub(super) next: BlockMut<'a, T>,
        pub(super) d_next: BlockMut<'a, T>,
        pub(super) terms: &'a mut [Pc3Terms<T>],
    }
}

/// How many standard normal numbers a sample needs: for z', and for both parts of the curvature's step.
pub(super) fn noise_width(latent: usize, action: usize) -> usize {
    2 * latent + action
}

impl<'a, T: Real> Pass<'a, Pc3Loss, T, Columns<'_, T>> {
    /// Computes z' = E(x') + sigma e and F(·|E(x), u).
    pub(super) fn forward(mut self) {
        vectorize(
            #[inline(always)]
            || self.encode_and_predict(),
        );
    }

    /// Evaluates the other terms, and takes the gradients of NCE and consistency to the encoder. `center` is the mean of
    /// E(x) over the batch.
    pub(super) fn backward(mut self, center: &[T]) {
        vectorize(
            #[inline(always)]
            || {
                self.curvature();
                self.back_through_dynamics();
                self.back_through_codes(center);
                self.c.nets.encoder.backward(&self.step.model.arena);
            },
        );
    }

    /// The noise of z', and that of the curvature's step in z and u.
    #[inline(always)]
    fn noise(&self, i: usize) -> (&'a [T], [&'a [T]; 2]) {
        let (n, width) = (self.latent(), noise_width(self.latent(), self.step.model.sizes.action));
        let (next, curvature) = self.noise_of(i, width).split_at(n);
        (next, curvature.split_at(n).into())
    }

    #[inline(always)]
    fn encode_and_predict(&mut self) {
        let (step, n) = (self.step, self.latent());
        let pairs = &step.batch.pairs[2 * self.first..2 * (self.first + self.samples)];
        self.c.nets.encoder.forward(&step.model.arena, (step.batch.images, pairs));
        let sigma = T::of(step.loss.sigma);
        for i in 0..self.samples {
            let ((noise, _), action) = (self.noise(i), self.action(i));
            let GaussianPair { first: now, second: next, .. } = GaussianPair::of(self.c.nets.encoder.codes(), n, i);
            let (z, u) = self.c.nets.dynamics_input.sample(i).split_at_mut(n);
            z.copy_from_slice(&now[..n]);
            u.copy_from_slice(action);
            let noisy = self.c.next.sample(i);
            for k in 0..n {
                noisy[k] = sigma.fma(noise[k], next[k]);
            }
        }
        let nets = &mut self.c.nets;
        step.model.nets.dynamics.forward(&step.model.arena, nets.dynamics_input.data, &mut nets.dynamics);
        // F's means are relative to z.
        let (gaussians, _) = nets.dynamics.output_and_delta();
        for (i, gaussian) in gaussians.chunks_exact_mut(2 * n).enumerate() {
            gaussian.iter_mut().zip(&nets.dynamics_input.sample(i)[..n]).for_each(|(mean, &z)| *mean += z);
        }
    }

    /// L_cur of F at (z, u), for all samples (PCC, equation 8); see `lce::curvature`.
    #[inline(always)]
    fn curvature(&mut self) {
        let (step, n) = (self.step, self.latent());
        let sigma = T::of(step.loss.curvature_sigma);
        for i in 0..self.samples {
            let ((_, noise), action) = (self.noise(i), self.action(i));
            let z = &self.c.nets.dynamics_input.sample(i)[..n];
            self.c.curvature.set(i, [z, action], noise, sigma);
        }
        let (weight, terms) = (T::of(step.loss.curvature) * step.mean, &mut self.c.terms);
        self.c.curvature.run(&step.model.nets, &step.model.arena, weight, |i, value| terms[i].curvature = value);
    }

    /// Takes the gradients of F's Gaussians to F's inputs.
    #[inline(always)]
    fn back_through_dynamics(&mut self) {
        let (model, nets) = (self.step.model, &mut self.c.nets);
        let d_input = Some(&mut *nets.d_dynamics_input.data);
        model.nets.dynamics.backward(&model.arena, nets.dynamics_input.data, &mut nets.dynamics, d_input);
    }

    /// Evaluates the terms on the codes alone. Takes the gradients of z' and of F's inputs to the codes.
    #[inline(always)]
    fn back_through_codes(&mut self, center: &[T]) {
        let (step, n) = (self.step, self.latent());
        let pull = T::of(2.0 * step.loss.center) * step.mean;
        self.c.nets.passive_forward(step.model);
        self.c.nets.encoder.codes().1.fill(T::ZERO);
        for i in 0..self.samples {
            let (action, nets) = (self.action(i), &mut self.c.nets);
            let GaussianPair { d_first: d_now, d_second: d_next, .. } = GaussianPair::of(nets.encoder.codes(), n, i);
            let (_, d_predictions) = nets.dynamics.output_and_delta();
            let (d_input, d_noisy) = (nets.d_dynamics_input.sample(i), self.c.d_next.sample(i));
            for k in 0..n {
                d_now[k] = d_predictions[2 * n * i + k] + d_input[k] + pull * center[k];
                d_next[k] = d_noisy[k];
            }
            let weight = T::of(step.loss.anchor) * step.mean;
            let mut anchor = nets.anchor(i, &step.model.sizes, action, T::of(step.loss.anchor_scale));
            self.c.terms[i].anchor = anchor.squared(weight);
        }
        self.c.nets.passive_backward(step.model);
    }
}
