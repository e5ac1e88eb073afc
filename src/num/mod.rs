//! Numerics that every layer may use: random streams, sampling, portable functions, small linear algebra, vector
//! registers, threads, statistics.

#[cfg(test)]
pub(crate) mod instruction_sets;
pub mod linalg;
pub mod math;
mod real;
pub mod rng;
pub mod sampling;
pub mod simd;
pub mod stats;
mod threads;

pub use real::Real;
pub use threads::{Threads, join};

/// The arithmetic that all results of this build depend on. It is a constant, whatever processor runs the program. The
/// key of every node holds it.
pub const PLATFORM: &str = "x86_64-fma-1";
