//! The parameters of `train_lce` and their defaults.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{
    control::guidance::Guidance,
    lce::{Differences, PassiveDynamics, pc3::Pc3, warm_up::WarmUp},
    nn::binary_images::Likelihood,
    stage::Symmetries,
};

/// The loss that a model is trained with.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(in crate::stage) enum LossName {
    /// The loss of CARL.
    Carl,
    /// The loss of CARL, with L_p and L_c weighted by the TD errors of the agent `value`.
    ValueGuided(Guidance),
    /// The loss of PCC. Its VAE term has a prior on the codes.
    Pcc,
    /// The loss of PC3, which has no decoder. Only the warm-up decodes.
    Pc3(Pc3),
    /// The loss of E2C, with a locally linear F.
    E2c,
    /// The loss of RCE, with a locally linear F.
    Rce,
}

impl LossName {
    /// Whether F is a locally linear transition.
    pub(super) fn is_locally_linear(&self) -> bool {
        matches!(self, Self::E2c | Self::Rce)
    }

    /// Whether the loss trains the decoder.
    pub(super) fn decodes(&self) -> bool {
        !matches!(self, Self::Pc3(_))
    }

    /// The standard deviation of codes where the encoder learns none of its own.
    pub(super) fn code_sigma(&self) -> Option<f64> {
        match self {
            Self::Pc3(pc3) => Some(pc3.sigma),
            _ => None,
        }
    }
}

/// How L_cur, and later iLQR, get the slopes A and B of F.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(in crate::stage) enum Slopes {
    /// By differentiating F.
    Exact(Refit),
    /// From heads of F that L_cur trains: PCC's amortized version. The heads read F, so F is not fitted once more.
    Amortized,
}

/// How F is fitted once more to the codes of the trained encoder.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(in crate::stage) struct Refit {
    /// Steps at the end that fit F alone to the final codes, with the step size of the warm-up.
    pub(super) refit_steps: u64,
}

/// The encoder and decoder of a new model.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(in crate::stage) enum Networks {
    /// The networks of the paper, convolutional for its larger images.
    Paper,
    /// Fully connected with two hidden layers of 128. They read the share of lit pixels in each patch of the image.
    PooledPatches(Patches),
    /// One such network reads each of two frames. A code holds positions in the newest frame, then differences to the
    /// older.
    SharedFrames(FramePatches),
}

/// How a frame is read, and what a code holds of the frames.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(in crate::stage) struct FramePatches {
    /// Rows and columns of a patch that the encoder reads, in pixels.
    pub(super) side: u64,
    /// Rows and columns of a patch that the decoder predicts, in pixels: a multiple of `side`.
    pub(super) predicted_side: u64,
    /// Share of the patches that each training step hides from the networks.
    pub(super) dropout: f64,
    /// Coordinates of the newest frame.
    pub(super) coordinates: u64,
    /// What a code holds of the differences between the frames' coordinates.
    pub(super) differences: Differences,
}

impl Default for FramePatches {
    fn default() -> Self {
        let differences = Differences::Scaled { scale: 2.0 };
        Self { side: 4, predicted_side: 4, dropout: 0.2, coordinates: 4, differences }
    }
}

/// How images are cut into patches.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(in crate::stage) struct Patches {
    /// Rows and columns of a patch, in pixels.
    pub(super) side: u64,
    /// Share of the patches that each training step hides from the networks.
    pub(super) dropout: f64,
}

impl Default for Patches {
    fn default() -> Self {
        Self { side: 8, dropout: 0.0 }
    }
}

impl Networks {
    /// Share of the inputs that each training step hides.
    pub(super) fn dropout(self) -> f64 {
        match self {
            Self::Paper => 0.0,
            Self::PooledPatches(patches) => patches.dropout,
            Self::SharedFrames(frames) => frames.dropout,
        }
    }
}

/// Widths of networks in place of those that the task gives, or the choice `networks`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(in crate::stage) struct Widths {
    /// Dimension of the latent space. Networks that share frames have `coordinates` instead.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) latent: Option<u64>,
    /// Hidden layers of the encoder.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) encoder: Option<[u64; 2]>,
    /// Hidden layers of the decoder.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) decoder: Option<[u64; 2]>,
    /// Hidden layers of the dynamics.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) dynamics: Option<[u64; 2]>,
}

impl Widths {
    /// Whether all widths are those of the task. Then they stand in no key.
    fn are_the_tasks(&self) -> bool {
        *self == Self::default()
    }
}

/// The warm-up, which a new model begins with.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(in crate::stage) struct WarmUpSchedule {
    /// Of `epochs`, passes with the anchored warm-up at the beginning. A model from `warm_start` has none.
    pub(super) epochs: u64,
    /// Of the warm-up, passes at its beginning that train the geometry alone and decode no images.
    pub(super) anchor_epochs: u64,
    /// Adam step size of the warm-up.
    pub(super) learning_rate: f64,
    /// Constants of the warm-up's loss.
    pub(super) loss: WarmUp,
}

impl Default for WarmUpSchedule {
    fn default() -> Self {
        Self { epochs: 150, anchor_epochs: 50, learning_rate: 2e-3, loss: WarmUp::default() }
    }
}

/// The ramp, in which the weight of consistency grows to its full value.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(in crate::stage) struct Ramp {
    /// Of `epochs`, passes of the ramp, after the warm-up. A model from `warm_start` has none.
    pub(super) epochs: u64,
    /// Share of the consistency weight at the beginning of the ramp.
    pub(super) from: f64,
}

impl Default for Ramp {
    fn default() -> Self {
        Self { epochs: 50, from: 0.02 }
    }
}

/// Weights of the terms of the loss.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(in crate::stage) struct Lambda {
    /// L_ed, encoding and decoding.
    pub(super) encode_decode: f64,
    /// KL from the codes to a unit Gaussian, a part of PCC's VAE term.
    pub(super) prior: f64,
    /// L_p, prediction.
    pub(super) prediction: f64,
    /// L_c, consistency; in E2C, the KL of the transition.
    pub(super) consistency: f64,
    /// L_cur, curvature.
    pub(super) curvature: f64,
    /// L_reg; needs the inputs `warm_start` and `policy`, and no `symmetries`.
    pub(super) regularizer: f64,
    /// Reconstruction from the mean of the encoder.
    pub(super) deterministic: f64,
    /// The anchor of the warm-up, which stays in the loss with this weight.
    pub(super) anchor: f64,
}

#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(in crate::stage) struct Params {
    /// The loss that the model is trained with.
    pub(super) objective: LossName,
    /// The encoder and decoder of a new model. A model from `warm_start` keeps its own.
    pub(super) networks: Networks,
    /// How the decoder of a new model predicts pixels.
    #[serde(skip_serializing_if = "is_bernoulli")]
    pub(super) likelihood: Likelihood,
    /// Widths of a new model's networks that differ from those of the task.
    #[serde(skip_serializing_if = "Widths::are_the_tasks")]
    pub(super) widths: Widths,
    /// Passes over the transitions, warm-up and ramp included.
    pub(super) epochs: u64,
    /// The warm-up of a new model.
    pub(super) warm_up: WarmUpSchedule,
    /// The ramp after the warm-up.
    pub(super) ramp: Ramp,
    /// Symmetries of the task, each with the share of the transitions that it changes. The networks learn from the
    /// changed transitions. Map checks and value-guided weights use the unchanged ones.
    pub(super) symmetries: Symmetries,
    /// Number of randomly changed copies of the transitions. A training step draws one copy of every transition. Has no
    /// effect without `symmetries`.
    pub(super) symmetric_copies: u64,
    /// The passive dynamics of the codes that the anchor assumes.
    pub(super) passive_dynamics: PassiveDynamics,
    /// Weights of the terms of the loss.
    pub(super) lambda: Lambda,
    /// Standard deviation of the noise in L_cur.
    pub(super) curvature_sigma: f64,
    /// How L_cur gets the slopes of F.
    pub(super) slopes: Slopes,
    /// Maximum number of retrainings from new weights when a map check fails; the best map is kept. Where a retraining
    /// replaces a model from `warm_start`, its warm-up and ramp come on top of `epochs`.
    pub(super) restarts: u64,
    /// The `action_alignment` below which a map counts as folded. 0 turns the check off, for tasks in which an action
    /// moves codes too little to measure it.
    pub(super) least_alignment: f64,
    /// Adam step size; the default is the paper's.
    pub(super) learning_rate: f64,
    /// L2 coefficient.
    pub(super) weight_decay: f64,
    /// Passes between two recorded latent maps.
    pub(super) map_every: u64,
}

/// Bernoulli pixels stand in no key.
fn is_bernoulli(likelihood: &Likelihood) -> bool {
    *likelihood == Likelihood::Bernoulli
}

/// No bound, as in the paper: e^80 is close to the largest number of single precision.
pub(super) const UNBOUNDED: f64 = 80.0;

impl Default for Lambda {
    fn default() -> Self {
        Self {
            encode_decode: 0.01,
            prior: 0.0,
            prediction: 1.0,
            consistency: 7.0,
            curvature: 1.0,
            regularizer: 0.0,
            deterministic: 0.3,
            anchor: 3.0,
        }
    }
}

impl Default for Params {
    fn default() -> Self {
        Self {
            objective: LossName::Carl,
            networks: Networks::Paper,
            likelihood: Likelihood::Bernoulli,
            widths: Widths::default(),
            epochs: 15,
            warm_up: WarmUpSchedule::default(),
            ramp: Ramp::default(),
            symmetries: Symmetries::default(),
            symmetric_copies: 4,
            passive_dynamics: PassiveDynamics::None,
            lambda: Lambda::default(),
            curvature_sigma: 0.1,
            slopes: Slopes::Exact(Refit::default()),
            restarts: 2,
            least_alignment: 0.8,
            learning_rate: 5e-4,
            weight_decay: 1e-3,
            map_every: 10,
        }
    }
}
