//! One function for every term of the loss. Each writes its value for one sample, and adds its weighted gradient.

use super::pass::Pass;
use crate::{lce::gaussian_pair::GaussianPair, nn::heads, num::Real};

/// The code that D decodes, by its place among the three of a sample.
#[derive(Debug, Clone, Copy)]
enum Decoded {
    /// z1 ~ E(·|x').
    Z1,
    /// z_e ~ E(·|x).
    Ze,
    /// The mean of F(·|mean E(x), u).
    PredictedMean,
}

/// Which of a sample's observations.
#[derive(Debug, Clone, Copy)]
enum Observation {
    /// x.
    Now,
    /// x'.
    Next,
}

impl<T: Real> Pass<'_, '_, T> {
    /// -ln D(x'|z1), the decoder's part of the prediction loss L_p (paper, equation "CARL-loss"; PCC, equation 6).
    #[inline(always)]
    pub(super) fn reconstruction(&mut self, i: usize) {
        let weight = T::of(self.step.weights.reconstruction) * self.guidance(i);
        self.c.terms[i].reconstruction = self.reconstruction_nll(i, Observation::Next, Decoded::Z1, weight);
    }

    /// The encoding-decoding loss L_ed = -ln D(x|z_e) (paper, equation "error-term-PI-observation").
    #[inline(always)]
    pub(super) fn encode_decode(&mut self, i: usize) {
        let weight = T::of(self.step.weights.encode_decode);
        self.c.terms[i].encode_decode = self.reconstruction_nll(i, Observation::Now, Decoded::Ze, weight);
    }

    /// The deterministic reconstruction loss -ln D(x'|mean F(mean E(x), u)) (paper, "Training Hyper-Parameters").
    #[inline(always)]
    pub(super) fn deterministic(&mut self, i: usize) {
        let weight = T::of(self.step.weights.deterministic);
        self.c.terms[i].deterministic = self.reconstruction_nll(i, Observation::Next, Decoded::PredictedMean, weight);
    }

    /// The curvature loss L_cur of F around (z_e, u), for all samples (PCC, equation 8); see `lce::curvature`.
    #[inline(always)]
    pub(super) fn curvature(&mut self) {
        let (step, n) = (self.step, self.latent());
        let sigma = T::of(step.batch.curvature_sigma);
        for i in 0..self.samples {
            let (noise, action) = (self.noise(i), self.action(i));
            let z_e = &self.c.nets.decoder_input.sample(i)[n..2 * n];
            self.c.curvature.set(i, [z_e, action], [noise.curvature_z, noise.curvature_u], sigma);
        }
        let (weight, terms) = (T::of(step.weights.curvature) * step.mean, &mut self.c.terms);
        self.c.curvature.run(&step.model.nets, &step.model.arena, weight, |i, value| terms[i].curvature = value);
    }

    /// ln F(z1|z_q, u). Its negative is a part of L_p and L_c (PCC, equations 6 and 7).
    #[inline(always)]
    pub(super) fn log_density(&mut self, i: usize) {
        let (weight, n) = (self.consistency_weight(i), self.latent());
        let GaussianPair { first: from_z_q, d_first: d_from_z_q, .. } =
            GaussianPair::of(self.c.nets.dynamics.output_and_delta(), n, i);
        let (z1, d_z1) = (self.c.z1.sample(i), self.c.d_z1.sample(i));
        self.c.terms[i].log_density = heads::log_density(z1, from_z_q, -weight, d_z1, d_from_z_q);
    }

    /// KL(B(·|z1, u, x) || E(·|x)), a part of L_p and L_c (PCC, equations 6 and 7). The gradient of B's Gaussian starts
    /// here.
    #[inline(always)]
    pub(super) fn kl_backward(&mut self, i: usize) {
        let (weight, n) = (self.consistency_weight(i), self.latent());
        let GaussianPair { first: now, d_first: d_now, .. } = GaussianPair::of(self.c.nets.encoder.codes(), n, i);
        let (gaussian, d_gaussian) = self.c.backward.gaussian_and_gradient(i);
        d_gaussian.fill(T::ZERO);
        self.c.terms[i].kl_backward = heads::kl(gaussian, now, weight, d_gaussian, d_now);
    }

    /// The entropy H(E(·|x')). Its negative is a part of L_p and L_c (PCC, equations 6 and 7).
    #[inline(always)]
    pub(super) fn entropy(&mut self, i: usize) {
        let (weight, n) = (self.consistency_weight(i), self.latent());
        let GaussianPair { second: next, d_second: d_next, .. } = GaussianPair::of(self.c.nets.encoder.codes(), n, i);
        self.c.terms[i].entropy = heads::entropy(next, -weight, d_next);
    }

    /// KL(E(·|x) || N(0, I)) of PCC's VAE term (paper, "Training Hyper-Parameters").
    #[inline(always)]
    pub(super) fn prior(&mut self, i: usize) {
        let (weight, n) = (T::of(self.step.weights.prior) * self.step.mean, self.latent());
        let GaussianPair { first: now, d_first: d_now, .. } = GaussianPair::of(self.c.nets.encoder.codes(), n, i);
        self.c.terms[i].prior = heads::kl_to_unit(now, weight, d_now);
    }

    /// The regularizer L_reg(E, E_-, pi, x) (paper, equation "PI-observation"), at the mean of E(x).
    #[inline(always)]
    pub(super) fn regularizer(&mut self, i: usize) {
        let Some(regularizer) = self.step.batch.regularizer else { return };
        let (weight, n) = (T::of(self.step.weights.regularizer) * self.step.mean, self.latent());
        let GaussianPair { first: now, d_first: d_now, .. } = GaussianPair::of(self.c.nets.encoder.codes(), n, i);
        self.c.terms[i].regularizer = regularizer(self.first + i, &now[..n], weight, &mut d_now[..n]);
    }

    /// The anchor |E(x') - E(x) - h(E(x)) - p|² of the means; see `lce::anchor`.
    #[inline(always)]
    pub(super) fn anchor(&mut self, i: usize) {
        let (step, action) = (self.step, self.action(i));
        let scale = T::of(step.batch.anchor_scale);
        let mut anchor = self.c.nets.anchor(i, &step.model.sizes, action, scale);
        self.c.terms[i].anchor = anchor.squared(T::of(step.weights.anchor) * step.mean);
    }

    /// The value-guided weight exp(tau/gamma w) of L_p and L_c (paper, "Value-Guided CARL"); 1 without guidance.
    #[inline(always)]
    fn guidance(&self, i: usize) -> T {
        self.step.batch.guidance.map_or(T::ONE, |guidance| guidance[self.first + i])
    }

    /// What the gradient of L_c is multiplied by.
    #[inline(always)]
    fn consistency_weight(&self, i: usize) -> T {
        T::of(self.step.weights.consistency) * self.guidance(i) * self.step.mean
    }

    /// -ln D(observation|decoded code). Sets the gradient with respect to the logits.
    #[inline(always)]
    fn reconstruction_nll(&mut self, i: usize, observation: Observation, decoded: Decoded, weight: T) -> T {
        let (step, entries) = (self.step, self.step.model.sizes.predicted_entries());
        let image = step.batch.pairs[2 * (self.first + i) + observation as usize];
        let column = 3 * i + decoded as usize;
        self.c.nets.reconstruction_nll(column, entries, (step.batch.images, image), weight * step.mean)
    }
}
