//! Forward and backward through the networks of E2C for some samples of a batch.

use super::{
    settings::{E2cLoss, E2cTerms},
    transition_kl::transition_kl,
};
use crate::{
    lce::{gaussian_pair::GaussianPair, passes::PassColumns, transition_batch::Pass},
    nn::{
        columns::{BlockMut, cut_together},
        heads,
    },
    num::{Real, simd::vectorize},
};

cut_together! {
    /// Networks and terms of some samples, and a buffer of one code for each.
    pub(super) struct Columns<'a, T> {
        pub(super) nets: PassColumns<'a, T>,
        pub(super) scratch: BlockMut<'a, T>,
        pub(super) terms: &'a mut [E2cTerms<T>],
    }
}

impl<'a, T: Real> Pass<'a, E2cLoss, T, Columns<'_, T>> {
    /// Computes terms and deltas. Everything runs under `vectorize`, because outside of it a fused multiply-add is a
    /// function call.
    pub(super) fn run(mut self) {
        vectorize(
            #[inline(always)]
            || {
                self.encode_and_predict();
                self.decode();
                self.back_through_transitions();
                self.back_through_codes();
                self.c.nets.encoder.backward(&self.step.model.arena);
            },
        );
    }

    /// The noise of z.
    #[inline(always)]
    fn noise(&self, i: usize) -> &'a [T] {
        self.noise_of(i, self.latent())
    }

    /// Samples z ~ E(·|x). D's inputs become z and A z + B u + o, with the transition at z.
    #[inline(always)]
    fn encode_and_predict(&mut self) {
        let (step, n) = (self.step, self.latent());
        let pairs = &step.batch.pairs[2 * self.first..2 * (self.first + self.samples)];
        self.c.nets.encoder.forward(&step.model.arena, (step.batch.images, pairs));
        for i in 0..self.samples {
            let (noise, action, nets) = (self.noise(i), self.action(i), &mut self.c.nets);
            let GaussianPair { first: now, .. } = GaussianPair::of(nets.encoder.codes(), n, i);
            let (z, u) = nets.dynamics_input.sample(i).split_at_mut(n);
            heads::sample(now, noise, z);
            u.copy_from_slice(action);
        }
        let nets = &mut self.c.nets;
        step.model.nets.dynamics.forward(&step.model.arena, nets.dynamics_input.data, &mut nets.dynamics);
        let (gaussians, _) = nets.dynamics.output_and_delta();
        for (i, gaussian) in gaussians.chunks_exact(2 * n).enumerate() {
            let (z, decoded) = (&nets.dynamics_input.sample(i)[..n], nets.decoder_input.sample(i));
            for k in 0..n {
                (decoded[k], decoded[n + k]) = (z[k], z[k] + gaussian[k]);
            }
        }
    }

    /// Applies D, evaluates the terms on its logits, and returns to its inputs.
    #[inline(always)]
    fn decode(&mut self) {
        let (arena, loss) = (&self.step.model.arena[..], self.step.loss);
        self.c.nets.decoder.forward(arena, self.c.nets.decoder_input.data);
        for i in 0..self.samples {
            // The two decoded codes of a sample are compared with its two observations.
            self.c.terms[i].encode_decode = self.reconstruction_nll(2 * i, loss.encode_decode);
            self.c.terms[i].prediction = self.reconstruction_nll(2 * i + 1, loss.prediction);
        }
        self.c.nets.decoder.backward(arena, self.c.nets.d_decoder_input.data);
    }

    /// -ln D of an observation at the `column`th decoded code. Sets the gradient with respect to the logits.
    #[inline(always)]
    fn reconstruction_nll(&mut self, column: usize, weight: f64) -> T {
        let (step, entries) = (self.step, self.step.model.sizes.predicted_entries());
        let image = step.batch.pairs[2 * self.first + column];
        self.c.nets.reconstruction_nll(column, entries, (step.batch.images, image), T::of(weight) * step.mean)
    }

    /// Evaluates the transition's KL, and takes the gradients of transitions and predicted codes to F's inputs.
    #[inline(always)]
    fn back_through_transitions(&mut self) {
        let (step, n, first, a) = (self.step, self.latent(), self.first, self.step.model.sizes.action);
        let weight = T::of(step.loss.transition_kl) * step.mean;
        let Columns { nets, scratch, terms } = &mut self.c;
        let PassColumns { encoder, d_decoder_input, dynamics_input, d_dynamics_input, dynamics, .. } = nets;
        let (_, d_gaussians) = dynamics.output_and_delta();
        for (i, d_gaussian) in d_gaussians.chunks_exact_mut(2 * n).enumerate() {
            d_gaussian[..n].copy_from_slice(&d_decoder_input.sample(i)[n..]);
        }
        encoder.codes().1.fill(T::ZERO);
        let d_input = Some(&mut *d_dynamics_input.data);
        step.model.nets.dynamics.locally_linear().backward_with(
            &step.model.arena,
            dynamics_input.data,
            dynamics,
            d_input,
            #[inline(always)]
            |i, transition, d_transition| {
                let (codes, scratch) = (GaussianPair::of(encoder.codes(), n, i), scratch.sample(i));
                let u = &step.batch.actions[(first + i) * a..][..a];
                terms[i].transition_kl = transition_kl(codes, u, transition, weight, d_transition, scratch);
            },
        );
    }

    /// Evaluates the prior and the anchor. Takes the gradient of z to E(·|x).
    #[inline(always)]
    fn back_through_codes(&mut self) {
        let (step, n) = (self.step, self.latent());
        let [prior, anchor] = [step.loss.prior, step.loss.anchor].map(|weight| T::of(weight) * step.mean);
        self.c.nets.passive_forward(step.model);
        for i in 0..self.samples {
            let (noise, action, nets) = (self.noise(i), self.action(i), &mut self.c.nets);
            let GaussianPair { first: now, d_first: d_now, .. } = GaussianPair::of(nets.encoder.codes(), n, i);
            // A z + B u + o contains z itself.
            let (d_z, d_decoded) = (&mut nets.d_dynamics_input.sample(i)[..n], nets.d_decoder_input.sample(i));
            for k in 0..n {
                d_z[k] += d_decoded[k] + d_decoded[n + k];
            }
            heads::sample_backward(now, noise, d_z, d_now);
            self.c.terms[i].prior = heads::kl_to_unit(now, prior, d_now);
            let mut anchored = nets.anchor(i, &step.model.sizes, action, T::of(step.loss.anchor_scale));
            self.c.terms[i].anchor = anchored.squared(anchor);
        }
        self.c.nets.passive_backward(step.model);
    }
}
