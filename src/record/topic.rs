//! The topics that have a fixed place in the view. Any other topic is recorded too, and its curves are shown in a tab of
//! their own.

/// Terms of the latent model's loss, per step.
pub const TRAIN_LCE: &str = "/train/lce";
/// Terms of the warm-up loss, per step.
pub const TRAIN_WARM_UP: &str = "/train/warm_up";
/// Value-guided weights: TD errors and the spread of the weights, per model.
pub const TRAIN_GUIDANCE: &str = "/train/guidance";
/// Losses, temperature and entropy of SAC, per step.
pub const TRAIN_SAC: &str = "/train/sac";
/// Divergence between the old and the new actor, per step.
pub const TRAIN_DISTILL: &str = "/train/distill";
/// Terms of SOLAR's ELBO, per step.
pub const TRAIN_SOLAR: &str = "/train/solar";
/// What an iteration of SOLAR's controller did.
pub const CONTROL_SOLAR: &str = "/control/solar";
/// The smoothed latents of an iteration's rollouts, over their true positions.
pub const LATENT_SMOOTHED: &str = "/latent/smoothed";
/// The latents of known states.
pub const LATENT_MAP: &str = "/latent/map";
/// An observation while data are collected.
pub const PICTURE_COLLECTED: &str = "/picture/collected";
/// An observation that the model gets.
pub const PICTURE_OBSERVATION: &str = "/picture/observation";
/// The same observation after encoder and decoder.
pub const PICTURE_RECONSTRUCTION: &str = "/picture/reconstruction";
/// The model's prediction of the next observation.
pub const PICTURE_PREDICTION: &str = "/picture/prediction";
/// Evaluated episodes in true space.
pub const TRAJECTORY: &str = "/evaluate/trajectory";
/// The obstacles of the true space.
pub const OBSTACLES: &str = "/evaluate/obstacles";
/// Percent of time in the goal, per round: `percent_goal`, `policy_alone`, `paper` and `ceiling`, or some of these.
pub const PERCENT_GOAL: &str = "/evaluate/percent_goal";
