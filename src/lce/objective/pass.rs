//! Forward and backward through all networks for some samples of a batch.
//!
//! Samples: z1 ~ E(·|x'), z_q ~ B(·|z1, u, x), z_e ~ E(·|x). F predicts from (z_q, u) and from (mean E(x), u), and L_cur
//! linearises F around (z_e, u). D decodes z1, z_e and F's mean.

use super::{
    batch::{Batch, Noise},
    columns::Columns,
    terms::Weights,
};
use crate::{
    lce::{gaussian_pair::GaussianPair, model::LceModel},
    nn::heads,
    num::{Real, simd::vectorize},
};

/// What all samples of a step share.
pub(super) struct Step<'a, T> {
    pub(super) model: &'a LceModel<T>,
    pub(super) weights: &'a Weights,
    pub(super) batch: &'a Batch<'a, T>,
    /// 1 over the number of samples.
    pub(super) mean: T,
}

/// Some samples of a step.
pub(super) struct Pass<'a, 'c, T> {
    pub(super) step: &'a Step<'a, T>,
    /// The number of the first sample in the batch.
    pub(super) first: usize,
    pub(super) samples: usize,
    pub(super) c: Columns<'c, T>,
}

impl<'a, T: Real> Pass<'a, '_, T> {
    /// Computes terms and deltas. Everything runs under `vectorize`, because outside of it a fused multiply-add is a
    /// function call.
    pub(super) fn run(mut self) {
        vectorize(
            #[inline(always)]
            || {
                self.encode();
                self.look_back();
                self.predict();
                self.curvature();
                self.decode();
                self.back_through_dynamics();
                self.back_through_samples();
                self.back_through_codes();
                self.c.nets.encoder.backward(&self.step.model.arena);
            },
        );
    }

    #[inline(always)]
    pub(super) fn latent(&self) -> usize {
        self.step.model.sizes.latent
    }

    #[inline(always)]
    pub(super) fn noise(&self, i: usize) -> Noise<'a, T> {
        let sizes = &self.step.model.sizes;
        Noise::of(self.step.batch.noise, sizes.latent, sizes.action, self.first + i)
    }

    #[inline(always)]
    pub(super) fn action(&self, i: usize) -> &'a [T] {
        let a = self.step.model.sizes.action;
        &self.step.batch.actions[(self.first + i) * a..][..a]
    }

    /// Applies E to x and x'. Samples z1 and z_e.
    #[inline(always)]
    fn encode(&mut self) {
        let (step, n) = (self.step, self.latent());
        let pairs = &step.batch.pairs[2 * self.first..2 * (self.first + self.samples)];
        self.c.nets.encoder.forward(&step.model.arena, (step.batch.images, pairs));
        for i in 0..self.samples {
            let noise = self.noise(i);
            let GaussianPair { first: now, second: next, .. } = GaussianPair::of(self.c.nets.encoder.codes(), n, i);
            let z1 = self.c.z1.sample(i);
            heads::sample(next, noise.z1, z1);
            let decoded = self.c.nets.decoder_input.sample(i);
            decoded[..n].copy_from_slice(z1);
            heads::sample(now, noise.z_e, &mut decoded[n..2 * n]);
        }
    }

    /// Applies B to (z1, u, x). F's first input becomes (z_q, u) with z_q ~ B, its second (mean E(x), u).
    #[inline(always)]
    fn look_back(&mut self) {
        let step = self.step;
        let (n, a) = (self.latent(), step.model.sizes.action);
        let (first, last) = (self.first, self.first + self.samples);
        let (u, x) = (&step.batch.actions[first * a..last * a], &step.batch.x[first..last]);
        self.c.backward.forward(&step.model.arena, (self.c.z1.data, u), (step.batch.images, x));
        for i in 0..self.samples {
            let (noise, action) = (self.noise(i), self.action(i));
            let GaussianPair { first: now, .. } = GaussianPair::of(self.c.nets.encoder.codes(), n, i);
            let (from_z_q, from_mean) = self.c.nets.dynamics_input.sample(i).split_at_mut(n + a);
            heads::sample(self.c.backward.gaussian(i), noise.z_q, &mut from_z_q[..n]);
            from_mean[..n].copy_from_slice(&now[..n]);
            from_z_q[n..].copy_from_slice(action);
            from_mean[n..].copy_from_slice(action);
        }
    }

    /// Applies F to both inputs and makes its means absolute. D's third input becomes the mean of F(·|mean E(x), u).
    #[inline(always)]
    fn predict(&mut self) {
        let step = self.step;
        let (n, a) = (self.latent(), step.model.sizes.action);
        let nets = &mut self.c.nets;
        step.model.nets.dynamics.forward(&step.model.arena, nets.dynamics_input.data, &mut nets.dynamics);
        let (gaussians, _) = nets.dynamics.output_and_delta();
        for (gaussian, input) in gaussians.chunks_exact_mut(2 * n).zip(nets.dynamics_input.data.chunks_exact(n + a)) {
            for i in 0..n {
                gaussian[i] += input[i];
            }
        }
        for i in 0..self.samples {
            let GaussianPair { second: from_mean, .. } = GaussianPair::of(nets.dynamics.output_and_delta(), n, i);
            nets.decoder_input.sample(i)[2 * n..].copy_from_slice(&from_mean[..n]);
        }
    }

    /// Applies D, evaluates the terms on its logits, and returns to its inputs.
    #[inline(always)]
    fn decode(&mut self) {
        let arena = &self.step.model.arena[..];
        self.c.nets.decoder.forward(arena, self.c.nets.decoder_input.data);
        for i in 0..self.samples {
            self.reconstruction(i);
            self.encode_decode(i);
            self.deterministic(i);
        }
        self.c.nets.decoder.backward(arena, self.c.nets.d_decoder_input.data);
    }

    /// Evaluates ln F(z1|z_q, u), and takes the gradients of F's Gaussians to F's inputs.
    #[inline(always)]
    fn back_through_dynamics(&mut self) {
        let (step, n) = (self.step, self.latent());
        self.c.nets.dynamics.output_and_delta().1.fill(T::ZERO);
        for i in 0..self.samples {
            let d_decoded = self.c.nets.d_decoder_input.sample(i);
            self.c.d_z1.sample(i).copy_from_slice(&d_decoded[..n]);
            let GaussianPair { d_second: d_from_mean, .. } =
                GaussianPair::of(self.c.nets.dynamics.output_and_delta(), n, i);
            d_from_mean[..n].copy_from_slice(&d_decoded[2 * n..]);
            self.log_density(i);
        }
        let nets = &mut self.c.nets;
        let d_input = Some(&mut *nets.d_dynamics_input.data);
        step.model.nets.dynamics.backward(&step.model.arena, nets.dynamics_input.data, &mut nets.dynamics, d_input);
    }

    /// Evaluates the terms on E(·|x) and B. Takes gradients from z_e to E(·|x), from z_q to B, and from B to z1.
    #[inline(always)]
    fn back_through_samples(&mut self) {
        let (step, n) = (self.step, self.latent());
        for i in 0..self.samples {
            self.back_through_skip_connections(i);
            let noise = self.noise(i);
            let GaussianPair { first: now, d_first: d_now, .. } = GaussianPair::of(self.c.nets.encoder.codes(), n, i);
            let d_z_e = &self.c.nets.d_decoder_input.sample(i)[n..2 * n];
            heads::sample_backward(now, noise.z_e, d_z_e, d_now);
            self.kl_backward(i);
            let (gaussian, d_gaussian) = self.c.backward.gaussian_and_gradient(i);
            let d_z_q = &self.c.nets.d_dynamics_input.sample(i)[..n];
            heads::sample_backward(gaussian, noise.z_q, d_z_q, d_gaussian);
            self.prior(i);
            self.regularizer(i);
        }
        self.c.backward.backward(&step.model.arena, self.c.d_z1.data);
    }

    /// F's means are relative to F's inputs, so their gradients also flow to the inputs directly: to z_q, and to the
    /// mean of E(x), whose gradient starts here.
    #[inline(always)]
    fn back_through_skip_connections(&mut self, i: usize) {
        let (n, a) = (self.latent(), self.step.model.sizes.action);
        let nets = &mut self.c.nets;
        let (d_z_q, d_mean) = nets.d_dynamics_input.sample(i).split_at_mut(n + a);
        let predicted = GaussianPair::of(nets.dynamics.output_and_delta(), n, i);
        let GaussianPair { d_first: d_now, .. } = GaussianPair::of(nets.encoder.codes(), n, i);
        d_now.fill(T::ZERO);
        for k in 0..n {
            d_z_q[k] += predicted.d_first[k];
            d_now[k] += d_mean[k] + predicted.d_second[k];
        }
    }

    /// Evaluates the terms on E(·|x'), and the anchor. Takes the gradient from z1 to E(·|x').
    #[inline(always)]
    fn back_through_codes(&mut self) {
        let (step, n) = (self.step, self.latent());
        self.c.nets.passive_forward(step.model);
        for i in 0..self.samples {
            let noise = self.noise(i);
            let GaussianPair { second: next, d_second: d_next, .. } =
                GaussianPair::of(self.c.nets.encoder.codes(), n, i);
            d_next.fill(T::ZERO);
            heads::sample_backward(next, noise.z1, self.c.d_z1.sample(i), d_next);
            self.entropy(i);
            self.anchor(i);
        }
        self.c.nets.passive_backward(step.model);
    }
}
