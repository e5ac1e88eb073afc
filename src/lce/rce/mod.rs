//! The loss of RCE, "Robust Locally-Linear Controllable Embedding" (Banijamali, Shu, Ghavamzadeh, Bui and Ghodsi, AISTATS
//! 2018): a bound of ln p(x'|x, u) through codes that move by locally linear transitions.
//!
//! The bound is derived here, since the authors' weights are not public. With z ~ E(·|x) and an independent point
//! z̄ ~ E(·|x), the model is z' = A(z̄) z + B(z̄) u + o(z̄) and x' ~ D(·|z'). Given z̄, z' is a Gaussian with mean
//! A mu + B u + o and covariance A S A', where E(·|x) = N(mu, S). With q(z') = E(·|x') and q(z̄) = B(·|z', u, x),
//! Jensen's inequality gives
//!
//! ln p(x'|x, u) >= E_q \[ln D(x'|z') + ln N(z'; A mu + B u + o, A S A') - KL(q(z̄) || E(·|x))\] + H(E(·|x')).

mod log_density;
mod losses;
mod settings;
mod workspace;

pub use settings::{RceLoss, RceTerms};
pub use workspace::RceWorkspace;

#[cfg(test)]
mod tests;
