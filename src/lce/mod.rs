//! The latent controllable embedding: encoder, dynamics, decoder and backward dynamics, and what trains them.

mod backward;

mod curvature;
pub mod detectors;
pub mod model;
pub mod objective;
pub mod trainer;
pub mod warm_up;

pub use model::{LceModel, Sizes};
