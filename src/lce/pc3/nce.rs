//! NCE over a batch: F must tell from which past a code comes. The consistency is its diagonal.

use crate::{
    nn::heads::HALF_LN_TAU,
    num::{Real, simd::vectorize},
};

/// Keeps the logarithm of a vanishing probability finite, as in the authors' code.
const LEAST: f64 = 1e-8;

/// What the gradients of a sample's two terms are multiplied by.
#[derive(Debug, Clone, Copy)]
pub(super) struct PairWeights<T> {
    pub(super) nce: T,
    pub(super) consistency: T,
}

/// The two terms of one sample.
#[derive(Debug, Clone, Copy)]
pub(super) struct PairTerms<T> {
    pub(super) nce: T,
    pub(super) log_density: T,
}

/// Buffers. Coordinate `k` of past `j` is at `k` times the number of pasts plus `j`, so that loops over pasts run along
/// memory.
#[derive(Debug, Clone)]
pub(super) struct Nce<T> {
    means: Vec<T>,
    /// 1 / sigma.
    inverses: Vec<T>,
    /// ln of the Gaussian's peak.
    peaks: Vec<T>,
    d_means: Vec<T>,
    d_log_sigmas: Vec<T>,
    /// (z' - mean) / sigma of one z'.
    units: Vec<T>,
    /// s_j = ln F(z'|past j) of one z', then the gradient with respect to it.
    scores: Vec<T>,
}

impl<T: Real> Nce<T> {
    /// Buffers for up to `samples` samples of `latent` coordinates.
    pub(super) fn new(latent: usize, samples: usize) -> Self {
        let [means, inverses, d_means, d_log_sigmas, units] = [(); 5].map(|()| vec![T::ZERO; latent * samples]);
        let [peaks, scores] = [(); 2].map(|()| vec![T::ZERO; samples]);
        Self { means, inverses, peaks, d_means, d_log_sigmas, units, scores }
    }

    /// For the codes `next` and the Gaussians F(·|past j), passes both terms of every code to `value`. Sets `d_next` and
    /// `d_gaussians` to the weighted gradient.
    ///
    /// With s_ij = ln F(z'_i|past j), NCE of code i is -ln(e^(s_ii - m) / mean_j e^(s_ij - m) + 1e-8), where m = max_j s_ij.
    pub(super) fn run(
        &mut self,
        (next, d_next): (&[T], &mut [T]),
        (gaussians, d_gaussians): (&[T], &mut [T]),
        latent: usize,
        weights: PairWeights<T>,
        mut value: impl FnMut(usize, PairTerms<T>),
    ) {
        let samples = next.len() / latent;
        vectorize(
            #[inline(always)]
            || {
                self.take(gaussians, latent);
                for (i, (next, d_next)) in next.chunks_exact(latent).zip(d_next.chunks_exact_mut(latent)).enumerate() {
                    self.score(next, samples);
                    value(i, self.slopes(i, samples, weights));
                    self.back(d_next, samples);
                }
                self.give(d_gaussians, latent);
            },
        );
    }

    /// Brings the Gaussians into the buffers' order.
    #[inline(always)]
    fn take(&mut self, gaussians: &[T], latent: usize) {
        let samples = gaussians.len() / (2 * latent);
        for (j, gaussian) in gaussians.chunks_exact(2 * latent).enumerate() {
            self.peaks[j] = T::ZERO;
            for k in 0..latent {
                let (at, log_sigma) = (k * samples + j, gaussian[latent + k]);
                (self.means[at], self.inverses[at]) = (gaussian[k], (-log_sigma).e_to());
                (self.d_means[at], self.d_log_sigmas[at]) = (T::ZERO, T::ZERO);
                self.peaks[j] -= log_sigma + T::of(HALF_LN_TAU);
            }
        }
    }

    /// The scores of one code under all pasts.
    #[inline(always)]
    fn score(&mut self, next: &[T], samples: usize) {
        let (scores, minus_half) = (&mut self.scores[..samples], T::of(-0.5));
        scores.copy_from_slice(&self.peaks[..samples]);
        for (k, &z) in next.iter().enumerate() {
            let of = k * samples..(k + 1) * samples;
            let (means, inverses) = (&self.means[of.clone()], &self.inverses[of.clone()]);
            let units = &mut self.units[of];
            for j in 0..samples {
                units[j] = (z - means[j]) * inverses[j];
                scores[j] = (minus_half * units[j]).fma(units[j], scores[j]);
            }
        }
    }

    /// Both terms of code `i`. The scores become the gradients with respect to them.
    #[inline(always)]
    fn slopes(&mut self, i: usize, samples: usize, weights: PairWeights<T>) -> PairTerms<T> {
        let scores = &mut self.scores[..samples];
        let log_density = scores[i];
        let largest = scores.iter().fold(scores[0], |largest, &score| largest.larger(score));
        scores.iter_mut().for_each(|score| *score = (*score - largest).e_to());
        let sum = scores.iter().fold(T::ZERO, |sum, &e| sum + e);
        let ratio = scores[i] * T::of(samples as f64) / sum;
        let with_least = ratio + T::of(LEAST);
        let slope = weights.nce * ratio / with_least;
        let share = slope / sum;
        scores.iter_mut().for_each(|e| *e *= share);
        scores[i] -= slope + weights.consistency;
        PairTerms { nce: -with_least.log(), log_density }
    }

    /// Takes the scores' gradients to the code, and adds them to those of all pasts.
    #[inline(always)]
    fn back(&mut self, d_next: &mut [T], samples: usize) {
        let slopes = &self.scores[..samples];
        for (k, d_next) in d_next.iter_mut().enumerate() {
            let of = k * samples..(k + 1) * samples;
            let (units, inverses) = (&self.units[of.clone()], &self.inverses[of.clone()]);
            let (d_means, d_log_sigmas) = (&mut self.d_means[of.clone()], &mut self.d_log_sigmas[of]);
            for j in 0..samples {
                d_means[j] = slopes[j].fma(units[j] * inverses[j], d_means[j]);
                d_log_sigmas[j] = slopes[j].fma(units[j].fma(units[j], -T::ONE), d_log_sigmas[j]);
            }
            *d_next = -(0..samples).fold(T::ZERO, |sum, j| slopes[j].fma(units[j] * inverses[j], sum));
        }
    }

    /// Writes the Gaussians' gradients in their own order.
    #[inline(always)]
    fn give(&self, d_gaussians: &mut [T], latent: usize) {
        let samples = d_gaussians.len() / (2 * latent);
        for (j, d_gaussian) in d_gaussians.chunks_exact_mut(2 * latent).enumerate() {
            for k in 0..latent {
                let at = k * samples + j;
                (d_gaussian[k], d_gaussian[latent + k]) = (self.d_means[at], self.d_log_sigmas[at]);
            }
        }
    }
}
