//! Forward and backward through the networks of the warm-up for some samples of a batch, with one function for every term.

use super::{
    columns::Columns,
    settings::{WarmUp, WarmUpBatch},
};
use crate::{
    lce::{anchor::PseudoHuber, gaussian_pair::GaussianPair, model::LceModel},
    num::{Real, simd::vectorize},
};

/// What all samples of a step share.
pub(super) struct Step<'a, T> {
    pub(super) model: &'a LceModel<T>,
    pub(super) settings: &'a WarmUp,
    pub(super) batch: &'a WarmUpBatch<'a, T>,
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

impl<T: Real> Pass<'_, '_, T> {
    /// Computes terms and deltas. Everything runs under `vectorize`, because outside of it a fused multiply-add is a
    /// function call.
    pub(super) fn run(mut self) {
        vectorize(
            #[inline(always)]
            || {
                self.encode_and_predict();
                self.decode();
                self.back_through_dynamics();
                self.back_through_codes();
                self.c.nets.encoder.backward(&self.step.model.arena);
            },
        );
    }

    #[inline(always)]
    fn latent(&self) -> usize {
        self.step.model.sizes.latent
    }

    /// Applies E to x and x', and F to (mean E(x), u). D's inputs become E(x) + s e and F(E(x), u) + s e.
    #[inline(always)]
    fn encode_and_predict(&mut self) {
        let (step, n, a) = (self.step, self.latent(), self.step.model.sizes.action);
        let (first, last) = (self.first, self.first + self.samples);
        let nets = &mut self.c.nets;
        nets.encoder.forward(&step.model.arena, (step.batch.images, &step.batch.pairs[2 * first..2 * last]));
        let (codes, _) = nets.encoder.codes();
        for (i, codes) in codes.chunks_exact(4 * n).enumerate() {
            let (z, u) = nets.dynamics_input.sample(i).split_at_mut(n);
            z.copy_from_slice(&codes[..n]);
            u.copy_from_slice(&step.batch.actions[(first + i) * a..][..a]);
        }
        step.model.nets.dynamics.forward(&step.model.arena, nets.dynamics_input.data, &mut nets.dynamics);
        let sigma = T::of(step.settings.sigma);
        let (predictions, _) = nets.dynamics.output_and_delta();
        for (i, (z, predicted)) in codes.chunks_exact(4 * n).zip(predictions.chunks_exact_mut(2 * n)).enumerate() {
            let noise = &step.batch.noise[(first + i) * 2 * n..][..2 * n];
            let decoded = nets.decoder_input.sample(i);
            for k in 0..n {
                predicted[k] += z[k];
                decoded[k] = sigma.fma(noise[k], z[k]);
                decoded[n + k] = sigma.fma(noise[n + k], predicted[k]);
            }
        }
    }

    /// Applies D, evaluates the terms on its logits, and returns to its inputs. Without decoding all of this is zero.
    #[inline(always)]
    fn decode(&mut self) {
        let arena = &self.step.model.arena[..];
        if !self.step.batch.decode {
            self.c.nets.d_decoder_input.data.fill(T::ZERO);
            for terms in &mut *self.c.terms {
                (terms.encode_decode, terms.prediction) = (T::ZERO, T::ZERO);
            }
            return;
        }
        self.c.nets.decoder.forward(arena, self.c.nets.decoder_input.data);
        for i in 0..self.samples {
            // The two decoded codes of a sample are compared with its two observations.
            self.c.terms[i].encode_decode = self.reconstruction_nll(2 * i);
            self.c.terms[i].prediction = self.reconstruction_nll(2 * i + 1);
        }
        self.c.nets.decoder.backward(arena, self.c.nets.d_decoder_input.data);
    }

    /// -ln D of an observation at the `column`th decoded code. Sets the gradient with respect to the logits.
    #[inline(always)]
    fn reconstruction_nll(&mut self, column: usize) -> T {
        let (step, entries) = (self.step, self.step.model.sizes.predicted_entries());
        let image = step.batch.pairs[2 * self.first + column];
        self.c.nets.reconstruction_nll(column, entries, (step.batch.images, image), step.mean)
    }

    /// Evaluates the consistency term, and takes gradients from F's means to its inputs.
    #[inline(always)]
    fn back_through_dynamics(&mut self) {
        self.c.nets.dynamics.output_and_delta().1.fill(T::ZERO);
        self.c.nets.encoder.codes().1.fill(T::ZERO);
        for i in 0..self.samples {
            self.consistency(i);
        }
        let (model, nets) = (self.step.model, &mut self.c.nets);
        let d_input = Some(&mut *nets.d_dynamics_input.data);
        model.nets.dynamics.backward(&model.arena, nets.dynamics_input.data, &mut nets.dynamics, d_input);
    }

    /// The consistency term |F(E(x), u) - E(x')|² / 2s². Adds D's gradient to F's mean, too.
    #[inline(always)]
    fn consistency(&mut self, i: usize) {
        let (n, sigma) = (self.latent(), self.step.settings.sigma);
        let inverse = T::of(1.0 / (sigma * sigma)) * self.step.mean;
        let nets = &mut self.c.nets;
        let GaussianPair { second: next, d_second: d_next, .. } = GaussianPair::of(nets.encoder.codes(), n, i);
        let (predictions, d_predictions) = nets.dynamics.output_and_delta();
        let predicted = &predictions[2 * n * i..][..n];
        let d_predicted = &mut d_predictions[2 * n * i..][..n];
        let d_decoded = &nets.d_decoder_input.sample(i)[n..];
        let mut sum = T::ZERO;
        for k in 0..n {
            let residual = predicted[k] - next[k];
            sum += residual * residual;
            d_predicted[k] = d_decoded[k] + inverse * residual;
            d_next[k] -= inverse * residual;
        }
        self.c.terms[i].consistency = sum * T::of(0.5 / (sigma * sigma));
    }

    /// Evaluates the terms on the codes alone. Takes gradients from the inputs of F and D to the codes.
    #[inline(always)]
    fn back_through_codes(&mut self) {
        let model = self.step.model;
        self.c.nets.passive_forward(model);
        for i in 0..self.samples {
            self.back_to_code_of_x(i);
            self.anchor(i);
            self.pull_on_codes(i);
        }
        self.c.nets.passive_backward(model);
    }

    /// The gradient of E(x)'s mean through F's skip connection, F's input and D's input.
    #[inline(always)]
    fn back_to_code_of_x(&mut self, i: usize) {
        let n = self.latent();
        let nets = &mut self.c.nets;
        let GaussianPair { d_first: d_now, .. } = GaussianPair::of(nets.encoder.codes(), n, i);
        let (_, d_predictions) = nets.dynamics.output_and_delta();
        let (d_input, d_decoded) = (nets.d_dynamics_input.sample(i), nets.d_decoder_input.sample(i));
        for k in 0..n {
            d_now[k] += d_predictions[2 * n * i + k] + d_input[k] + d_decoded[k];
        }
    }

    /// The anchor with a pseudo-Huber loss; see `lce::anchor`.
    #[inline(always)]
    fn anchor(&mut self, i: usize) {
        let (step, a, s) = (self.step, self.step.model.sizes.action, self.step.settings);
        let action = &step.batch.actions[(self.first + i) * a..][..a];
        let mut anchor = self.c.nets.anchor(i, &step.model.sizes, action, T::of(s.scale));
        let constants = PseudoHuber {
            inverse_variance: T::of(1.0 / (s.sigma * s.sigma)),
            delta_squared: T::of(s.huber_delta * s.huber_delta),
        };
        self.c.terms[i].anchor = anchor.pseudo_huber(constants, T::of(s.anchor), step.mean);
    }

    /// Adds the gradient of `shrink` |z|², and of the squared distance of the log standard deviations from ln s, for
    /// both codes.
    #[inline(always)]
    fn pull_on_codes(&mut self, i: usize) {
        let (n, s, mean) = (self.latent(), self.step.settings, self.step.mean);
        let (target, shrink) = (T::of(s.sigma).log(), T::of(2.0 * s.shrink) * mean);
        let (codes, d_codes) = self.c.nets.encoder.codes();
        let (codes, d_codes) = (&codes[4 * n * i..][..4 * n], &mut d_codes[4 * n * i..][..4 * n]);
        for (code, d_code) in codes.chunks_exact(2 * n).zip(d_codes.chunks_exact_mut(2 * n)) {
            for k in 0..n {
                d_code[k] = shrink.fma(code[k], d_code[k]);
                let residual = code[n + k] - target;
                d_code[n + k] += (residual + residual) * mean;
            }
        }
    }
}
