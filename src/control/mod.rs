//! Controllers in the latent space (the soft actor-critic agent and iLQR), their training, and closed-loop control from
//! pictures.

mod actor_kl;
pub mod agent;
pub mod distill;
pub mod guidance;
pub mod ilqr;
pub mod regularizer;
pub mod rollout;
pub mod sac;

pub use agent::Agent;
pub use ilqr::Ilqr;
