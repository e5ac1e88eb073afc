//! Model-based soft actor-critic in the latent space (paper, "Soft Actor Critic (SAC) Updates").

mod actor;
mod critics;
mod latent_rollout;
mod replay;
mod reward;
mod settings;
mod trainer;

pub use reward::Reward;
pub use settings::{BATCH, CriticActions, Sac, Temperature};
pub use trainer::{Codes, SacTerms, SacTrainer};

#[cfg(test)]
mod tests;
