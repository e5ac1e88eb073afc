//! The parameters of `train_lce`: defaults by task, loss and preset, and the weighted loss that they make.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::TrainLce;
use crate::{
    control::guidance::Guidance,
    lce::{
        PassiveDynamics,
        objective::{Regularizer, Weights},
        trainer::Objective,
        warm_up::WarmUp,
    },
    stage::{self, Preset, PresetOf, Refusal, Stage as _, above_zero, at_least_one, within},
};

/// Which loss.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(in crate::stage) enum LossName {
    /// CARL's.
    Carl,
    /// CARL's, with L_p and L_c weighted by the TD errors of `value`, once there is one.
    ValueGuided,
    /// PCC's: its VAE term has a prior on the codes, which CARL's L_ed has not.
    Pcc,
}

/// Where L_cur has the slopes A and B of F from, and iLQR after it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(in crate::stage) enum Slopes {
    /// From F's weights.
    Exact,
    /// From heads of F that L_cur teaches, PCC's amortized version.
    Amortized,
}

/// Which encoder and decoder a new model has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(in crate::stage) enum Networks {
    /// The paper's, convolutional on its larger pictures.
    Paper,
    /// Fully connected, two hidden layers of 128, on what share of each square of pixels is lit.
    #[serde(rename = "squares")]
    PooledPatches,
}

/// Weights of the terms of the loss.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(in crate::stage) struct Lambda {
    /// L_ed, encoding and decoding.
    encode_decode: f64,
    /// KL to a unit Gaussian, beside L_ed.
    prior: f64,
    /// L_p, prediction.
    prediction: f64,
    /// L_c, consistency.
    consistency: f64,
    /// L_cur, curvature.
    curvature: f64,
    /// L_reg; needs `warm_start` and `policy`.
    pub(super) regularizer: f64,
    /// Deterministic reconstruction.
    deterministic: f64,
    /// The anchor of the warm-up, which goes on weakly afterwards.
    anchor: f64,
}

#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(in crate::stage) struct Params {
    /// Which loss.
    pub(super) objective: LossName,
    /// Which encoder and decoder a new model has; a model that goes on from `warm_start` keeps its own.
    pub(super) networks: Networks,
    /// Rows and columns of the squares of `squares`.
    pub(super) square: u64,
    /// Share of the squares that networks miss in training, others at every step; needs `squares`.
    pub(super) input_dropout: f64,
    /// Passes over the transitions, those of warm-up and ramp included.
    pub(super) epochs: u64,
    /// Of these, passes with the anchored warm-up; none where a model goes on from `warm_start`.
    pub(super) warm_up_epochs: u64,
    /// Of the warm-up, passes at its beginning that learn the geometry alone: no pictures are decoded.
    pub(super) anchor_epochs: u64,
    /// Of these, passes over which consistency grows from `ramp_from` to its full weight; none where a
    /// model goes on from `warm_start`.
    pub(super) ramp_epochs: u64,
    /// Share of the consistency at the beginning of the ramp.
    ramp_from: f64,
    /// Constants of the warm-up.
    pub(super) warm_up: WarmUp,
    /// How codes move by themselves, for the anchor of warm-up and loss.
    pub(super) drift: PassiveDynamics,
    /// Weights of the terms of the loss.
    pub(super) lambda: Lambda,
    /// Weights of the transitions in `value_guided`.
    pub(super) guidance: Guidance,
    /// Standard deviation of the curvature's noise.
    curvature_sigma: f64,
    /// Where L_cur has F's slopes from.
    pub(super) slopes: Slopes,
    /// Steps at the end that fit F alone to the codes as they are then; none with amortized slopes, whose heads read F.
    pub(super) refit_steps: u64,
    /// Times that training begins again, with other weights and a warm-up, while detectors find the map collapsed or
    /// folded; the soundest of the maps stays. Instead of going on from `warm_start`, passes of warm-up and ramp are made
    /// besides `epochs`.
    pub(super) restarts: u64,
    /// Adam step size; the paper's.
    pub(super) learning_rate: f64,
    /// Adam step size of the warm-up.
    pub(super) warm_up_learning_rate: f64,
    /// L2 coefficient.
    pub(super) weight_decay: f64,
    /// Epochs between two recorded latent maps.
    pub(super) map_every: u64,
}

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
            square: 8,
            input_dropout: 0.0,
            epochs: 15,
            warm_up_epochs: 150,
            anchor_epochs: 50,
            ramp_epochs: 50,
            ramp_from: 0.02,
            warm_up: WarmUp::default(),
            drift: PassiveDynamics::None,
            lambda: Lambda::default(),
            guidance: Guidance::default(),
            curvature_sigma: 0.1,
            slopes: Slopes::Exact,
            refit_steps: 0,
            restarts: 2,
            learning_rate: 5e-4,
            warm_up_learning_rate: 2e-3,
            weight_decay: 1e-3,
            map_every: 10,
        }
    }
}

impl stage::Params for Params {
    fn preset(of: &PresetOf<'_>) -> Self {
        let mut params = Self { objective: given(of, "objective", LossName::Carl), ..Self::default() };
        if params.objective == LossName::Pcc {
            params.lambda.prior = params.lambda.encode_decode;
        }
        if of.preset == Preset::Paper {
            // The paper knows no warm-up, ramp, anchor nor restart, and says of L_reg only that its weight is small.
            (params.warm_up_epochs, params.ramp_epochs, params.lambda.anchor) = (0, 0, 0.0);
            params.restarts = 0;
            params.lambda.regularizer = if params.objective == LossName::Pcc { 0.0 } else { 0.01 };
            params.guidance = Guidance { bound: UNBOUNDED, normalize: false, ..params.guidance };
        }
        of.lay_task_over(TrainLce::KIND, params)
    }

    fn check(&self) -> Vec<Refusal> {
        let mut refusals = at_least_one("epochs", self.epochs);
        refusals.extend(at_least_one("map_every", self.map_every));
        within(&mut refusals, "ramp_from", self.ramp_from, 0.0, 1.0);
        within(&mut refusals, "square", self.square as f64, 1.0, 15.0);
        within(&mut refusals, "input_dropout", self.input_dropout, 0.0, 0.9);
        if self.networks != Networks::PooledPatches && self.input_dropout > 0.0 {
            refusals
                .push(Refusal { path: "input_dropout", why: "must be 0 without `networks = \"squares\"`".to_owned() });
        }
        let Lambda { encode_decode, prior, prediction, consistency, curvature, regularizer, deterministic, anchor } =
            self.lambda;
        for (path, value) in [
            ("lambda.encode_decode", encode_decode),
            ("lambda.prior", prior),
            ("lambda.prediction", prediction),
            ("lambda.consistency", consistency),
            ("lambda.curvature", curvature),
            ("lambda.regularizer", regularizer),
            ("lambda.deterministic", deterministic),
            ("lambda.anchor", anchor),
            ("weight_decay", self.weight_decay),
            ("warm_up.anchor", self.warm_up.anchor),
            ("warm_up.shrink", self.warm_up.shrink),
        ] {
            within(&mut refusals, path, value, 0.0, 1e6);
        }
        for (path, value) in [
            ("learning_rate", self.learning_rate),
            ("warm_up_learning_rate", self.warm_up_learning_rate),
            ("curvature_sigma", self.curvature_sigma),
            ("warm_up.sigma", self.warm_up.sigma),
            ("warm_up.scale", self.warm_up.scale),
            ("warm_up.outlier", self.warm_up.huber_delta),
        ] {
            above_zero(&mut refusals, path, value);
        }
        let Guidance { temperature, discount, samples, bound, .. } = self.guidance;
        within(&mut refusals, "guidance.temperature", temperature, 0.0, 1e6);
        within(&mut refusals, "guidance.discount", discount, 0.01, 1.0);
        within(&mut refusals, "guidance.samples", samples as f64, 1.0, 1e4);
        within(&mut refusals, "guidance.bound", bound, 0.0, UNBOUNDED);
        refusals
    }

    fn needs(&self) -> &'static [&'static str] {
        if self.objective == LossName::ValueGuided { &["warm_start", "value"] } else { &[] }
    }
}

/// What a file names, or else `usual`: other defaults follow from it.
fn given<'a, T: Deserialize<'a>>(of: &PresetOf<'a>, name: &str, usual: T) -> T {
    of.given.get(name).and_then(|named| T::deserialize(named).ok()).unwrap_or(usual)
}

/// As far as single precision goes: the paper knows no bound.
const UNBOUNDED: f64 = 80.0;

impl Params {
    /// The loss after `step` of the `ramp` steps over which consistency grows.
    pub(super) fn objective_at<'a>(
        &self,
        step: u64,
        ramp: u64,
        regularizer: Option<Regularizer<'a, f32>>,
        guidance: Option<&'a [f32]>,
    ) -> Objective<'a, f32> {
        let done = if ramp == 0 { 1.0 } else { (step as f64 / ramp as f64).min(1.0) };
        let share = self.ramp_from + (1.0 - self.ramp_from) * done;
        let lambda = &self.lambda;
        Objective {
            weights: Weights {
                reconstruction: lambda.prediction,
                consistency: (lambda.prediction + lambda.consistency) * share,
                curvature: lambda.curvature,
                encode_decode: lambda.encode_decode,
                prior: lambda.prior,
                deterministic: lambda.deterministic,
                regularizer: if regularizer.is_some() { lambda.regularizer } else { 0.0 },
                anchor: lambda.anchor * 0.5 / (self.warm_up.sigma * self.warm_up.sigma),
            },
            curvature_sigma: self.curvature_sigma,
            anchor_scale: self.warm_up.scale,
            guidance,
            regularizer,
        }
    }
}
