//! Linear algebra for small systems in double precision. Sums have a fixed order, so every machine gives the same bits.
//!
//! There are three solvers, because each of their callers depends on the order of its own operations:
//! - [`Matrix::cholesky`]: positive definite, factored once for several right-hand sides (iLQR);
//! - [`solve_positive_definite`]: of a size known at compile time, without allocation (equations of motion);
//! - [`solve_augmented`]: any square matrix, with row exchanges (least squares on few columns).

mod elimination;
mod matrix;

pub use elimination::{solve_augmented, solve_positive_definite};
pub use matrix::Matrix;
