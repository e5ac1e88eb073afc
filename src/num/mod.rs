//! Numerics that every layer may use: random streams, sampling, portable functions, vectors, threads, statistics.

pub mod math;
mod real;
pub mod rng;
pub mod sampling;
pub mod simd;
pub mod stats;
mod threads;

pub use real::Real;
pub use threads::{Threads, join};
