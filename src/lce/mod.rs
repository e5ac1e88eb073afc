//! The latent controllable embedding (LCE): encoder, dynamics, decoder and backward dynamics, and their training.

mod anchor;
pub mod auto_encoder;
pub mod backend;
mod backward;
mod by_kind;
mod curvature;
mod decoder;
pub mod dynamics;
pub mod e2c;
mod encoder;
pub mod ensemble;
mod gaussian_pair;
pub mod map_checks;
pub mod model;
pub mod nets;
pub mod objective;
mod passes;
pub mod passive_dynamics;
pub mod pc3;
pub mod prepared_encoder;
pub mod rce;
pub mod refit;
pub mod shared_frames;
pub mod sizes;
mod terms;
pub mod trainer;
mod transition_batch;
pub mod warm_up;

pub use ensemble::Ensemble;
pub use model::LceModel;
pub use passive_dynamics::PassiveDynamics;
pub use prepared_encoder::PreparedEncoder;
pub use shared_frames::{Differences, SharedFrames, Speeds};
pub use sizes::{BackwardSizes, ImageNetworks, Sizes};
pub use transition_batch::TransitionBatch;
