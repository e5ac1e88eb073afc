//! Controllers in the latent space (the soft actor-critic agent and iLQR), their training, and closed-loop control from
//! pictures.

mod actor_kl;
pub mod agent;
mod agent_policy;
pub mod distill;
pub mod episodes;
pub mod guidance;
pub mod ilqr;
mod oracle;
mod policy;
pub mod regularizer;
pub mod sac;
mod solar_policy;

pub use agent::Agent;
pub use agent_policy::{Acting, AgentPolicy};
pub use ilqr::{Ilqr, IlqrPolicy};
pub use oracle::OraclePolicy;
pub use policy::{Controller, Goal, Moment, Policy};
pub use solar_policy::SolarPolicy;
