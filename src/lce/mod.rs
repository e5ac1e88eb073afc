//! The latent controllable embedding: encoder, dynamics, decoder and backward dynamics, and what trains them.

mod backward;
mod curvature;
mod decoder;
pub mod detectors;
mod drift;
mod encoder;
pub mod model;
pub mod objective;
mod observer;
pub mod refit;
pub mod trainer;
pub mod warm_up;

pub use drift::Drift;
pub use model::{LceModel, Sizes};
pub use observer::Observer;
