//! The latent controllable embedding (LCE): encoder, dynamics, decoder and backward dynamics, and their training.

mod anchor;
pub mod backend;
mod backward;
mod by_kind;
mod curvature;
mod decoder;
mod encoder;
mod gaussian_pair;
pub mod map_checks;
pub mod model;
pub mod nets;
pub mod objective;
mod passes;
pub mod passive_dynamics;
pub mod prepared_encoder;
pub mod refit;
pub mod shared_frames;
pub mod sizes;
mod terms;
pub mod trainer;
pub mod warm_up;

pub use model::LceModel;
pub use passive_dynamics::PassiveDynamics;
pub use prepared_encoder::PreparedEncoder;
pub use shared_frames::{Differences, SharedFrames, Speeds};
pub use sizes::{BackwardSizes, ImageNetworks, Sizes};
