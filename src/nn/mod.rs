//! Networks by hand on faer matrices: layers, heads, Adam, kernels.

pub mod adam;
pub(crate) mod columns;
pub mod conv;
pub mod heads;
mod lanes;
pub mod mat;
pub mod math;
pub mod mlp;
pub mod noise;
pub mod pictures;
mod real;
mod threads;

pub use real::Real;
pub use threads::{Threads, join};

/// Runs a loop with the widest vectors the machine has. Element-wise loops give the same bits on each of them.
#[inline(always)]
pub fn vectorize<R>(body: impl FnOnce() -> R) -> R {
    arch().dispatch(body)
}

/// The widest instruction set of this machine.
pub(crate) fn arch() -> pulp::Arch {
    pulp::Arch::new()
}
