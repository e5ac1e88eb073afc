//! Model-based soft actor-critic in the latent space (paper, "Soft Actor Critic (SAC) Updates").

mod actor;
mod critics;
mod latent_box;
mod latent_rollout;
mod learner;
mod new_tuples;
mod replay;
mod reward;
mod rollout_dynamics;
mod settings;
mod speeds;
mod trainer;

pub use learner::Learner;
pub use replay::LatentBuffer;
pub use reward::Reward;
pub use settings::{BATCH, CriticActions, Sac, Temperature, Tuning};
pub use trainer::{Codes, SacTerms, SacTrainer};

#[cfg(test)]
mod tests;
