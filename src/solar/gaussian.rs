//! Gaussian potentials ψ(z) = exp(-½ zᵀJz + hᵀz), the local evidence of the structured posterior.

use super::Small;

/// ln 2π.
pub(super) const LN_TAU: f64 = 1.837_877_066_409_345_3;

/// A Gaussian potential by its precision J \[d, d\] and its linear term h \[d\]. Its natural parameters are (-J/2, h).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Potential {
    /// J.
    pub precision: Small,
    /// h, a column.
    pub linear: Small,
}

impl Potential {
    /// The potential that is proportional to N(z; mean, covariance); `None` if the covariance is not positive definite.
    pub fn of_gaussian(mean: &Small, covariance: &Small) -> Option<Self> {
        let (precision, _) = covariance.inverse()?;
        Some(Self { precision, linear: precision.times(mean) })
    }

    /// The product of two potentials.
    #[must_use]
    pub fn product(&self, other: &Self) -> Self {
        Self { precision: self.precision.plus(1.0, &other.precision), linear: self.linear.plus(1.0, &other.linear) }
    }

    /// Mean and covariance of the normalised potential; `None` if J is not positive definite.
    pub fn moments(&self) -> Option<(Small, Small)> {
        let (covariance, _) = self.precision.inverse()?;
        Some((covariance.times(&self.linear), covariance))
    }

    /// The logarithm of the potential's integral: ½ hᵀJ⁻¹h - ½ ln|J| + d/2 ln 2π.
    pub fn log_integral(&self) -> Option<f64> {
        let (covariance, log_determinant) = self.precision.inverse()?;
        let d = self.linear.rows() as f64;
        Some(0.5 * covariance.quadratic(&self.linear) - 0.5 * log_determinant + 0.5 * d * LN_TAU)
    }

    /// The entropy of the normalised potential.
    pub fn entropy(&self) -> Option<f64> {
        let (_, log_determinant) = self.precision.inverse()?;
        Some(0.5 * (self.linear.rows() as f64 * (LN_TAU + 1.0) - log_determinant))
    }

    /// KL(self || other) of the normalised potentials: <η_self - η_other, E t> - ln Z_self + ln Z_other.
    pub fn kl(&self, other: &Self) -> Option<f64> {
        let (mean, covariance) = self.moments()?;
        let second = covariance.plus(1.0, &mean.times_transposed(&mean));
        let precision = self.precision.plus(-1.0, &other.precision);
        let linear = self.linear.plus(-1.0, &other.linear);
        let natural = linear.inner(&mean) - 0.5 * precision.inner(&second);
        Some(natural - self.log_integral()? + other.log_integral()?)
    }
}
