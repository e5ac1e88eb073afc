//! Controllers in the latent space: the soft actor-critic agent, its training and its distillation, what its values say
//! to the representation, iLQR, and closed-loop control from pictures.

pub mod agent;
pub mod distill;
pub mod guidance;
pub mod ilqr;
pub mod regularizer;
pub mod rollout;
pub mod sac;

pub use agent::Agent;
pub use ilqr::Ilqr;
