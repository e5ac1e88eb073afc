//! The loss of PC3 (Shu et al., "Predictive Coding for Locally-Linear Control", ICML 2020): a latent model without a
//! decoder.
//!
//! E is deterministic: a code is the mean of our E. F must tell which of the batch's pasts a code follows (NCE), predict
//! it (consistency) and be locally linear (curvature). Signs and weights are those of the authors' public code.

mod losses;
mod nce;
mod settings;
mod workspace;

pub use settings::{Pc3, Pc3Loss, Pc3Terms};
pub use workspace::Pc3Workspace;
