//! SOLAR: a latent space in which dynamics are linear and Gaussian, learned by structured variational inference, and the
//! trust-region LQR that controls in it (Zhang, Vikram et al., "SOLAR", ICML 2019).
//!
//! Networks are in single precision, everything else is in double precision. z has d components and a has m; y = \[z; a\]
//! has p = d + m. The dynamics of each step are z' ~ N(F y, Σ), and (F, Σ) has a matrix-normal inverse-Wishart (MNIW)
//! distribution.

pub mod chain;
pub mod controller;
pub mod cost_fit;
mod eigen;
pub mod filter;
pub mod gaussian;
pub mod iteration;
pub mod local_dynamics;
pub mod lqr;
pub mod mniw;
pub mod model;
pub mod objective;
pub mod policy;
mod small;
mod special;
mod square;
pub mod trainer;
pub mod trust_region;

pub use controller::SolarController;
pub use model::{Push, SolarModel, is_without_dynamics};
pub use policy::LinearGaussianPolicy;
pub use small::{MOST, Small};

/// The most components of a latent state.
pub const MOST_LATENT: usize = 8;
/// The most components of an action.
pub const MOST_ACTION: usize = MOST - MOST_LATENT;
