//! Networks by hand on faer matrices: layers, heads, Adam, kernels.

mod threads;

pub use threads::Threads;
