//! The anchored warm-up: a predictive autoencoder in which an action moves the code by the same vector everywhere.
//!
//! From random weights the paper's loss collapses: the encoder's noise grows until codes carry no information. The
//! warm-up loss has one optimum, a code that is affine in the position, so it can neither collapse nor fold. Where a code
//! also moves without an action, [`PassiveDynamics`](super::PassiveDynamics) explain this motion. The warm-up uses
//! (x, u, x') alone.

mod columns;
mod losses;
mod settings;
mod workspace;

pub use settings::{WarmUp, WarmUpBatch, WarmUpTerms};
pub use workspace::WarmUpWorkspace;
