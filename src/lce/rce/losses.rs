//! Forward and backward through the networks of RCE for some samples of a batch, with one function for every term.

use super::{
    log_density::{Moved, log_density},
    settings::{RceLoss, RceTerms},
};
use crate::{
    lce::{backward::BackwardColumns, gaussian_pair::GaussianPair, passes::PassColumns, transition_batch::Pass},
    nn::{
        columns::{BlockMut, cut_together},
        heads,
    },
    num::{Real, simd::vectorize},
};

cut_together! {
    /// Networks, samples of z' and terms of some samples, and a buffer of two codes for each.
    pub(super) struct Columns<'a, T> {
        pub(super) nets: PassColumns<'a, T>,
        pub(super) backward: BackwardColumns<'a, T>,
        pub(super) d_next: BlockMut<'a, T>,
        pub(super) scratch: BlockMut<'a, T>,
        pub(super) terms: &'a mut [RceTerms<T>],
    }
}

impl<'a, T: Real> Pass<'a, RceLoss, T, Columns<'_, T>> {
    /// Computes terms and deltas. Everything runs under `vectorize`, because outside of it a fused multiply-add is a
    /// function call.
    pub(super) fn run(mut self) {
        vectorize(
            #[inline(always)]
            || {
                self.encode();
                self.look_back();
                self.decode();
                self.back_through_transitions();
                self.back_through_backward();
                self.back_through_codes();
                self.c.nets.encoder.backward(&self.step.model.arena);
            },
        );
    }

    /// The noise of z', and that of the transition's point.
    #[inline(always)]
    fn noise(&self, i: usize) -> (&'a [T], &'a [T]) {
        self.noise_of(i, 2 * self.latent()).split_at(self.latent())
    }

    /// What the gradient of the consistency's parts is multiplied by.
    #[inline(always)]
    fn consistency_weight(&self) -> T {
        T::of(self.step.loss.consistency) * self.step.mean
    }

    /// Samples z' ~ E(·|x').
    #[inline(always)]
    fn encode(&mut self) {
        let (step, n) = (self.step, self.latent());
        let pairs = &step.batch.pairs[2 * self.first..2 * (self.first + self.samples)];
        self.c.nets.encoder.forward(&step.model.arena, (step.batch.images, pairs));
        for i in 0..self.samples {
            let ((noise, _), nets) = (self.noise(i), &mut self.c.nets);
            let GaussianPair { second: next, .. } = GaussianPair::of(nets.encoder.codes(), n, i);
            heads::sample(next, noise, nets.decoder_input.sample(i));
        }
    }

    /// Applies B to (z', u, x), and computes the transition at a sample of B.
    #[inline(always)]
    fn look_back(&mut self) {
        let (step, n, a) = (self.step, self.latent(), self.step.model.sizes.action);
        let (first, last) = (self.first, self.first + self.samples);
        let (u, x) = (&step.batch.actions[first * a..last * a], &step.batch.x[first..last]);
        let next = &*self.c.nets.decoder_input.data;
        self.c.backward.forward(&step.model.arena, (next, u), (step.batch.images, x));
        for i in 0..self.samples {
            let ((_, noise), action) = (self.noise(i), self.action(i));
            let (point, u) = self.c.nets.dynamics_input.sample(i).split_at_mut(n);
            heads::sample(self.c.backward.gaussian(i), noise, point);
            u.copy_from_slice(action);
        }
        let nets = &mut self.c.nets;
        step.model.nets.dynamics.forward(&step.model.arena, nets.dynamics_input.data, &mut nets.dynamics);
    }

    /// Evaluates -ln D(x'|z'), and returns to z'.
    #[inline(always)]
    fn decode(&mut self) {
        let (step, arena, nets) = (self.step, &self.step.model.arena[..], &mut self.c.nets);
        let (entries, weight) = (step.model.sizes.predicted_entries(), T::of(step.loss.reconstruction) * step.mean);
        nets.decoder.forward(arena, nets.decoder_input.data);
        for i in 0..self.samples {
            let image = step.batch.pairs[2 * (self.first + i) + 1];
            self.c.terms[i].reconstruction = nets.reconstruction_nll(i, entries, (step.batch.images, image), weight);
        }
        nets.decoder.backward(arena, self.c.d_next.data);
    }

    /// Evaluates ln N(z'; A mu + B u + o, A S A'), and takes the gradients of transitions to their points.
    #[inline(always)]
    fn back_through_transitions(&mut self) {
        let (step, n, first, a) = (self.step, self.latent(), self.first, self.step.model.sizes.action);
        let weight = -self.consistency_weight();
        let Columns { nets, d_next, scratch, terms, .. } = &mut self.c;
        let PassColumns { encoder, decoder_input, dynamics_input, d_dynamics_input, dynamics, .. } = nets;
        // The step itself is not used, only its transition.
        dynamics.output_and_delta().1.fill(T::ZERO);
        encoder.codes().1.fill(T::ZERO);
        step.model.nets.dynamics.locally_linear().backward_with(
            &step.model.arena,
            dynamics_input.data,
            dynamics,
            Some(&mut *d_dynamics_input.data),
            #[inline(always)]
            |i, transition, d_transition| {
                let GaussianPair { first: now, d_first: d_now, .. } = GaussianPair::of(encoder.codes(), n, i);
                let u = &step.batch.actions[(first + i) * a..][..a];
                let moved = Moved { next: decoder_input.sample(i), gaussian: now, u };
                let d = (d_next.sample(i), d_now);
                terms[i].log_density = log_density(moved, transition, weight, d, d_transition, scratch.sample(i));
            },
        );
    }

    /// Evaluates KL(B || E(·|x)), and takes the gradients of points to B, and from B to z'.
    #[inline(always)]
    fn back_through_backward(&mut self) {
        let (step, n, weight) = (self.step, self.latent(), self.consistency_weight());
        for i in 0..self.samples {
            let (_, noise) = self.noise(i);
            let GaussianPair { first: now, d_first: d_now, .. } = GaussianPair::of(self.c.nets.encoder.codes(), n, i);
            let (gaussian, d_gaussian) = self.c.backward.gaussian_and_gradient(i);
            d_gaussian.fill(T::ZERO);
            self.c.terms[i].kl_backward = heads::kl(gaussian, now, weight, d_gaussian, d_now);
            let d_point = &self.c.nets.d_dynamics_input.sample(i)[..n];
            heads::sample_backward(gaussian, noise, d_point, d_gaussian);
        }
        self.c.backward.backward(&step.model.arena, self.c.d_next.data);
    }

    /// Evaluates the entropy of E(·|x') and the anchor. Takes the gradient of z' to E(·|x').
    #[inline(always)]
    fn back_through_codes(&mut self) {
        let (step, n, weight) = (self.step, self.latent(), self.consistency_weight());
        let anchor = T::of(step.loss.anchor) * step.mean;
        self.c.nets.passive_forward(step.model);
        for i in 0..self.samples {
            let ((noise, _), action, nets) = (self.noise(i), self.action(i), &mut self.c.nets);
            let GaussianPair { second: next, d_second: d_next, .. } = GaussianPair::of(nets.encoder.codes(), n, i);
            heads::sample_backward(next, noise, self.c.d_next.sample(i), d_next);
            self.c.terms[i].entropy = heads::entropy(next, -weight, d_next);
            let mut anchored = nets.anchor(i, &step.model.sizes, action, T::of(step.loss.anchor_scale));
            self.c.terms[i].anchor = anchored.squared(anchor);
        }
        self.c.nets.passive_backward(step.model);
    }
}
