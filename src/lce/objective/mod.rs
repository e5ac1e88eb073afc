//! The loss of CARL, PCC and value-guided CARL for one batch, and its gradient (paper, equation "CARL-loss").
//!
//! Where to find an equation: `losses` holds one function for every term, `curvature` (beside this folder) L_cur, `terms`
//! the weighted sum, and `pass` the samples that the terms are evaluated at.

mod batch;
mod columns;
mod losses;
mod pass;
mod terms;
mod workspace;

pub use batch::{Batch, Noise, Regularizer};
pub use terms::{Terms, Weights};
pub use workspace::Workspace;
