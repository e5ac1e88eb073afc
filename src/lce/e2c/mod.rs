//! The loss of E2C, "Embed to Control" (Watter, Springenberg, Boedecker and Riedmiller, NIPS 2015): a variational
//! autoencoder whose codes move by locally linear transitions.

mod losses;
mod settings;
mod transition_kl;
mod workspace;

pub use settings::{E2cLoss, E2cTerms};
pub use workspace::E2cWorkspace;
