//! The topics that the view knows where to draw. Any other topic is recorded and shown just the same, in a view for
//! what is left.

/// Terms of the latent model's loss, per step.
pub const TRAIN_LCE: &str = "/train/lce";
/// Terms of the warm-up loss, per step.
pub const TRAIN_WARM_UP: &str = "/train/warm_up";
/// Value-guided weights: their TD errors and how far they are from each other, per model.
pub const TRAIN_GUIDANCE: &str = "/train/guidance";
/// Losses, temperature and entropy of SAC, per step.
pub const TRAIN_SAC: &str = "/train/sac";
/// Divergence between the old and the new actor, per step.
pub const TRAIN_DISTILL: &str = "/train/distill";
/// Where known states lie in latent space.
pub const LATENT_MAP: &str = "/latent/map";
/// A picture as the world shows it while data are made.
pub const PICTURE_COLLECTED: &str = "/picture/collected";
/// A picture as the model sees it.
pub const PICTURE_OBSERVATION: &str = "/picture/observation";
/// The same picture after encoder and decoder.
pub const PICTURE_RECONSTRUCTION: &str = "/picture/reconstruction";
/// The next picture, as the model predicts it.
pub const PICTURE_PREDICTION: &str = "/picture/prediction";
/// Evaluated episodes in true space.
pub const TRAJECTORY: &str = "/evaluate/trajectory";
/// Obstacles of the true space.
pub const OBSTACLES: &str = "/evaluate/obstacles";
/// Per round, values `percent_goal`, `policy_alone`, `paper` and `ceiling`, or some of them.
pub const PERCENT_GOAL: &str = "/evaluate/percent_goal";
