//! The filter that acts: q(z_t | frames and actions so far), one step after another.

use super::{Small, mniw::Expected};

/// The precision and the linear term of z_t, given the potentials and actions that it has met.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Filter {
    precision: Small,
    linear: Small,
}

impl Filter {
    /// z_1 ~ N(0, I), before its potential.
    pub fn new(d: usize) -> Self {
        Self { precision: Small::diagonal(d, 1.0), linear: Small::zeros(d, 1) }
    }

    /// Multiplies the potential of the current frame: the diagonal of J, and h.
    pub fn observe(&mut self, precision: &[f64], linear: &[f64]) {
        for i in 0..precision.len() {
            *self.precision.at_mut(i, i) += precision[i];
            *self.linear.at_mut(i, 0) += linear[i];
        }
    }

    /// Mean and covariance of z_t; `None` if the precision is not positive definite.
    pub fn moments(&self) -> Option<(Small, Small)> {
        let (covariance, _) = self.precision.inverse()?;
        Some((covariance.times(&self.linear), covariance))
    }

    /// Goes on to the next step after an action, by the expected statistics of the dynamics; `None` if a precision is not
    /// positive definite.
    pub fn advance(&mut self, dynamics: &Expected, action: &[f64]) -> Option<()> {
        let (d, p) = (self.linear.rows(), dynamics.e3.rows());
        let (action, g) = (Small::column(action), dynamics.e3.scaled(-2.0));
        let (u_z, u_a) = (dynamics.e2.block(0..d, 0..d), dynamics.e2.block(0..d, d..p));
        let (inverse, _) = self.precision.plus(1.0, &g.block(0..d, 0..d)).inverse()?;
        let q = self.linear.plus(-1.0, &g.block(0..d, d..p).times(&action));
        let gain = inverse.times_transposed(&u_z);
        self.precision = dynamics.e1.scaled(-2.0).plus(-1.0, &u_z.times(&gain)).symmetric();
        self.linear = u_a.times(&action).plus(1.0, &gain.transposed_times(&q));
        Some(())
    }
}
