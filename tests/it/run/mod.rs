//! The cache and the runner, on toy kinds.

mod cache;
mod runs;
