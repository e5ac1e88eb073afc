//! The parts of the ELBO that are not networks: potentials from codes, the structured posterior, and the likelihood of
//! costs.

use super::{
    chain::{Chain, Evidence, EvidenceGradient, chain},
    gaussian::LN_TAU,
};
use crate::num::Real;

/// The model of costs, c ~ N(½ zᵀCz + cᵀz, 1). C is not constrained.
#[derive(Debug, Clone, PartialEq)]
pub struct CostModel {
    /// C, row by row, then c.
    pub weights: Vec<f64>,
}

impl CostModel {
    fn d(&self) -> usize {
        // d² + d numbers.
        (0..=super::MOST).find(|d| d * (d + 1) == self.weights.len()).unwrap_or(0)
    }

    /// ln N(cost; …, 1) at z. Adds `weight` times its gradient to `d_z`, and `own_weight` times its gradient to
    /// `d_weights`.
    pub fn log_likelihood(
        &self,
        z: &[f64],
        cost: f64,
        (weight, d_z): (f64, &mut [f64]),
        (own_weight, d_weights): (f64, &mut [f64]),
    ) -> f64 {
        let d = self.d();
        let (matrix, linear) = self.weights.split_at(d * d);
        let (d_matrix, d_linear) = d_weights.split_at_mut(d * d);
        let mut predicted = 0.0;
        for i in 0..d {
            let row: f64 = (0..d).map(|j| matrix[i * d + j] * z[j]).sum();
            predicted += (0.5 * row + linear[i]) * z[i];
        }
        let rest = cost - predicted;
        for i in 0..d {
            let slope: f64 = (0..d).map(|j| 0.5 * (matrix[i * d + j] + matrix[j * d + i]) * z[j]).sum();
            d_z[i] += weight * rest * (slope + linear[i]);
            d_linear[i] += own_weight * rest * z[i];
            for j in 0..d {
                d_matrix[i * d + j] += own_weight * rest * 0.5 * z[i] * z[j];
            }
        }
        -0.5 * (rest * rest + LN_TAU)
    }
}

/// The structured posterior of one trajectory, from the encoder's codes to a sample, and back. It keeps its buffers.
///
/// A code is a mean and the logarithm of a standard deviation, to which `floor` is added: without a floor, precisions
/// explode.
#[derive(Debug)]
pub struct Inference {
    /// The chain. Its dynamics are set before [`Inference::infer`].
    pub chain: Box<dyn Chain>,
    d: usize,
    floor: f64,
    precision: Vec<f64>,
    linear: Vec<f64>,
    d_precision: Vec<f64>,
    d_linear: Vec<f64>,
}

impl Inference {
    /// Buffers for trajectories of up to `steps` steps.
    pub fn new(d: usize, m: usize, steps: usize, floor: f64) -> Self {
        let buffer = || Vec::with_capacity(steps * d);
        Self {
            chain: chain(d, m, steps),
            d,
            floor,
            precision: buffer(),
            linear: buffer(),
            d_precision: buffer(),
            d_linear: buffer(),
        }
    }

    /// Computes q(z_1:T) for codes \[means; log standard deviations\], 2 d numbers a step. Returns ln Z.
    pub fn infer<T: Real>(&mut self, codes: &[T], actions: &[f64]) -> f64 {
        self.precision.clear();
        self.linear.clear();
        add_potentials(codes, self.d, self.floor, &mut self.precision, &mut self.linear);
        self.chain.smooth(Evidence { precision: &self.precision, linear: &self.linear }, actions)
    }

    /// The mean standard deviation of the codes.
    pub fn mean_std(&self) -> f64 {
        self.precision.iter().map(|precision| 1.0 / precision.sqrt()).sum::<f64>() / self.precision.len() as f64
    }

    /// Sets `d_codes` to the gradient of <d_z, sample> + kl_weight KL.
    pub fn backward<T: Real>(&mut self, codes: &[T], d_z: &[f64], kl_weight: f64, d_codes: &mut [T]) {
        let (count, d) = (self.precision.len(), self.d);
        for gradient in [&mut self.d_precision, &mut self.d_linear] {
            gradient.clear();
            gradient.resize(count, 0.0);
        }
        let gradient = EvidenceGradient { precision: &mut self.d_precision, linear: &mut self.d_linear };
        self.chain.sample_gradient(d_z, gradient);
        let gradient = EvidenceGradient { precision: &mut self.d_precision, linear: &mut self.d_linear };
        self.chain.kl_gradient(kl_weight, gradient);
        for (t, (code, d_code)) in codes.chunks_exact(2 * d).zip(d_codes.chunks_exact_mut(2 * d)).enumerate() {
            for i in 0..d {
                let at = t * d + i;
                let (precision, d_linear) = (self.precision[at], self.d_linear[at]);
                // J = σ⁻², h = μ σ⁻² and σ = floor + e^l.
                let (mean, std) = (code[i].f64(), 1.0 / precision.sqrt());
                let d_std = -2.0 * precision / std * (self.d_precision[at] + mean * d_linear);
                d_code[i] = T::of(d_linear * precision);
                d_code[d + i] = T::of(d_std * (std - self.floor));
            }
        }
    }
}

/// Appends the potentials of codes: the diagonals of J, and h.
pub fn add_potentials<T: Real>(codes: &[T], d: usize, floor: f64, precision: &mut Vec<f64>, linear: &mut Vec<f64>) {
    for code in codes.chunks_exact(2 * d) {
        for i in 0..d {
            let std = floor + libm::exp(code[d + i].f64());
            precision.push(1.0 / (std * std));
            linear.push(code[i].f64() / (std * std));
        }
    }
}
