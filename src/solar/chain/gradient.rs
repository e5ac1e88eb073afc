//! Gradients through the chain: of a sample, in reverse, and of the KL divergence, by a tangent pass.

use super::{
    EvidenceGradient,
    steps::{Step, Steps},
};
use crate::solar::square::{
    Square, Vector, apply, apply_transposed, plus, sum, symmetric, symmetric_outer, times, transposed,
};

impl<const D: usize> Steps<D> {
    /// Reverse mode of [`super::Chain::sample`].
    ///
    /// A sample is z_t = Q⁻¹ b + C ε with b = q + U_zᵀ z_t+1 and C Cᵀ = Q⁻¹. Gradients flow forwards in time through the
    /// samples, and then backwards through the filter.
    #[inline(always)]
    pub(super) fn reverse(&mut self, d_sample: &[f64], gradient: EvidenceGradient<'_>) {
        let (weights, _) = d_sample.as_chunks::<D>();
        let count = self.steps.len();
        self.d_samples.clear();
        let mut from_before = [0.0; D];
        for t in 0..count {
            let d_z = sum(&weights[t], &from_before);
            let d_b = apply(&self.steps[t].inverse, &d_z);
            self.d_samples.push([d_z, d_b]);
            if t + 1 < count {
                from_before = apply(&self.transition(t).u, &d_b);
            }
        }
        // The gradients with respect to the predicted precision and linear term of the step after t.
        let (mut d_predicted, mut d_linear) = ([[0.0; D]; D], [0.0; D]);
        let (mut next, zero) = (None, [0.0; D]);
        for t in (0..count).rev() {
            let Step { root, centre, gain, .. } = &self.steps[t];
            let [d_z, d_b] = &self.d_samples[t];
            let mean = sum(centre, &apply(gain, next.unwrap_or(&zero)));
            let from_next = apply(gain, &d_linear);
            let from_filter = times(&times(gain, &d_predicted), &transposed(gain));
            let mut d_q_matrix = plus(&from_filter, -1.0, &symmetric_outer(&from_next, centre));
            d_q_matrix = plus(&d_q_matrix, -1.0, &symmetric_outer(d_b, &mean));
            d_q_matrix = plus(&d_q_matrix, -1.0, &through_root(root, d_z, &self.noise[t]));
            d_predicted = symmetric(&d_q_matrix);
            d_linear = sum(d_b, &from_next);
            for i in 0..D {
                gradient.precision[t * D + i] += d_predicted[i][i];
                gradient.linear[t * D + i] += d_linear[i];
            }
            next = Some(&self.samples[t]);
        }
    }

    /// Adds `weight` times the derivative of (-½ E z², E z) in the direction (J, h).
    #[inline(always)]
    pub(super) fn tangent(&mut self, weight: f64, gradient: EvidenceGradient<'_>) {
        let count = self.steps.len();
        self.tangents.clear();
        let (mut d_predicted, mut d_linear) = ([[0.0; D]; D], [0.0; D]);
        for t in 0..count {
            let Step { centre, gain, .. } = &self.steps[t];
            let mut d_q_matrix = d_predicted;
            for i in 0..D {
                d_q_matrix[i][i] += self.precision[t][i];
            }
            let d_q = sum(&d_linear, &self.linear[t]);
            let inner: Vector<D> = {
                let change = apply(&d_q_matrix, centre);
                std::array::from_fn(|i| d_q[i] - change[i])
            };
            d_predicted = times(&times(&transposed(gain), &d_q_matrix), gain);
            d_linear = apply_transposed(gain, &inner);
            self.tangents.push((d_q_matrix, d_q));
        }
        let (mut d_mean, mut d_covariance) = ([0.0; D], [[0.0; D]; D]);
        for t in (0..count).rev() {
            let Step { inverse, gain, .. } = &self.steps[t];
            let (d_q_matrix, d_q) = &self.tangents[t];
            let change = apply(d_q_matrix, &self.means[t]);
            let inner: Vector<D> = std::array::from_fn(|i| d_q[i] - change[i]);
            d_mean = sum(&apply(inverse, &inner), &apply(gain, &d_mean));
            d_covariance = self.covariance_tangent(t, d_q_matrix, &d_covariance);
            for i in 0..D {
                let second = d_covariance[i][i] + 2.0 * self.means[t][i] * d_mean[i];
                gradient.precision[t * D + i] -= weight * 0.5 * second;
                gradient.linear[t * D + i] += weight * d_mean[i];
            }
        }
    }

    /// The derivative of S_t = Q⁻¹ + N with N = L S_t+1 Lᵀ: -S dQ Q⁻¹ - Q⁻¹ dQ N + L dS_t+1 Lᵀ.
    #[inline(always)]
    fn covariance_tangent(&self, t: usize, d_q_matrix: &Square<D>, d_next: &Square<D>) -> Square<D> {
        let Step { inverse, gain, .. } = &self.steps[t];
        let covariance = &self.covariances[t];
        let rest = plus(covariance, -1.0, inverse);
        let left = times(inverse, d_q_matrix);
        let through = plus(&times(&left, &rest), 1.0, &transposed(&times(&left, covariance)));
        symmetric(&plus(&times(&times(gain, d_next), &transposed(gain)), -1.0, &through))
    }
}

/// C sym(Φ(Cᵀ dC)) Cᵀ for dC = the lower triangle of d_z εᵀ, where Φ halves the diagonal of the lower triangle: minus the
/// gradient with respect to Q through C, the Cholesky factor of Q⁻¹.
#[inline(always)]
fn through_root<const D: usize>(root: &Square<D>, d_z: &Vector<D>, noise: &Vector<D>) -> Square<D> {
    let v = apply_transposed(root, d_z);
    let phi: Square<D> = std::array::from_fn(|i| std::array::from_fn(|j| 0.5 * v[i.max(j)] * noise[i.min(j)]));
    times(&times(root, &phi), &transposed(root))
}
