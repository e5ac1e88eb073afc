//! Learns the representation: encoder, dynamics, decoder and backward dynamics (paper, lines 3-7 of the CARL algorithm).

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Preset, PresetOf, Refusal, Stage, StageCx, above_zero, inputs, within};
use crate::{
    artifact::{TrainedModel, Transitions},
    control::{Agent, regularizer::PolicyRegularizer},
    env::EnvName,
    lce::{
        Drift, LceModel, Sizes, detectors,
        model::background,
        objective::{Regularizer, Terms, Weights},
        trainer::{BATCH, Data, Objective, Trainer},
        warm_up::WarmUp,
    },
    nn::{
        adam::{Adam, AdamSettings},
        noise,
    },
    record::{At, Level, topic},
};

/// Which loss.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(super) enum LossName {
    /// CARL's.
    Carl,
    /// PCC's: its VAE term has a prior on the codes, which CARL's L_ed has not.
    Pcc,
}

/// Which encoder and decoder a new model has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(super) enum Networks {
    /// The paper's, convolutional on its larger pictures.
    Paper,
    /// Fully connected, two hidden layers of 256: a fraction of the cost on larger pictures, where most pixels are dark.
    Dense,
}

/// Weights of the terms of the loss.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Lambda {
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
    regularizer: f64,
    /// Deterministic reconstruction.
    deterministic: f64,
    /// The anchor of the warm-up, which goes on weakly afterwards.
    anchor: f64,
}

#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Params {
    /// Which loss.
    objective: LossName,
    /// Which encoder and decoder a new model has; after a `warm_start` they stay what they are.
    networks: Networks,
    /// Passes over the transitions, those of warm-up and ramp included.
    epochs: u64,
    /// Of these, passes with the anchored warm-up; none after a `warm_start`.
    warm_up_epochs: u64,
    /// Of the warm-up, passes at its beginning that learn the geometry alone: no pictures are decoded.
    anchor_epochs: u64,
    /// Of these, passes over which consistency grows from `ramp_from` to its full weight; none after a `warm_start`.
    ramp_epochs: u64,
    /// Share of the consistency at the beginning of the ramp.
    ramp_from: f64,
    /// Constants of the warm-up.
    warm_up: WarmUp,
    /// How codes move by themselves, for the anchor of warm-up and loss.
    drift: Drift,
    /// Weights of the terms of the loss.
    lambda: Lambda,
    /// Standard deviation of the curvature's noise.
    curvature_sigma: f64,
    /// Adam step size; the paper's.
    learning_rate: f64,
    /// Adam step size of the warm-up.
    warm_up_learning_rate: f64,
    /// L2 coefficient.
    weight_decay: f64,
    /// Epochs between two recorded latent maps.
    map_every: u64,
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
            epochs: 15,
            warm_up_epochs: 150,
            anchor_epochs: 50,
            ramp_epochs: 50,
            ramp_from: 0.02,
            warm_up: WarmUp::default(),
            drift: Drift::None,
            lambda: Lambda::default(),
            curvature_sigma: 0.1,
            learning_rate: 5e-4,
            warm_up_learning_rate: 2e-3,
            weight_decay: 1e-3,
            map_every: 10,
        }
    }
}

impl super::Params for Params {
    fn preset(of: &PresetOf<'_>) -> Self {
        let mut params = Self::default();
        if of.given.get("objective").is_some_and(|objective| objective == "pcc") {
            params.objective = LossName::Pcc;
            params.lambda.prior = params.lambda.encode_decode;
        } else if matches!(of.task.env, EnvName::SwingUp | EnvName::ThreePole) {
            params.lambda.consistency = 11.0;
        }
        if of.preset == Preset::Paper {
            // The paper knows no warm-up, no ramp and no anchor, and says of L_reg only that its weight is small.
            (params.warm_up_epochs, params.ramp_epochs, params.lambda.anchor) = (0, 0, 0.0);
            params.lambda.regularizer = if params.objective == LossName::Carl { 0.01 } else { 0.0 };
        } else if of.task.env != EnvName::Planar {
            // Poles swing by themselves, and nothing blocks them: the anchor has no outliers.
            params.drift = Drift::Quadratic;
            params.warm_up = WarmUp { scale: 2.0, anchor: 100.0, outlier: 1000.0, ..params.warm_up };
            params.lambda.anchor = 10.0;
            if of.task.env != EnvName::SwingUp {
                // A thousand random transitions share no pictures here: without decoding, geometry is learned by heart.
                params.anchor_epochs = 0;
            }
        }
        params
    }

    fn check(&self) -> Vec<Refusal> {
        let mut refusals = super::at_least_one("epochs", self.epochs);
        refusals.extend(super::at_least_one("map_every", self.map_every));
        within(&mut refusals, "ramp_from", self.ramp_from, 0.0, 1.0);
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
            ("warm_up.outlier", self.warm_up.outlier),
        ] {
            above_zero(&mut refusals, path, value);
        }
        refusals
    }
}

inputs! {
    pub(super) struct Inputs {
        /// what to learn from
        transitions: Vec<Transitions>,
        /// the model to go on with; without one, training starts afresh, with a warm-up
        warm_start: Option<TrainedModel>,
        /// the policy that L_reg keeps
        policy: Option<Agent>,
    }
}

pub(super) struct TrainLce;

impl Stage for TrainLce {
    const KIND: &'static str = "train_lce";
    const VERSION: u32 = 1;
    const ABOUT: &'static str = "encoder, dynamics, decoder and backward dynamics by the loss of CARL or PCC";
    type Params = Params;
    type Inputs = Inputs;
    type Output = TrainedModel;

    fn run(params: &Params, inputs: Inputs, cx: &mut StageCx<'_>) -> anyhow::Result<TrainedModel> {
        let transitions = Transitions::concat(&inputs.transitions)?;
        let is_warm = inputs.warm_start.is_some();
        let regularizer = l_reg(params, &inputs, &transitions);
        let mut start = inputs.warm_start.clone().map_or_else(|| fresh(params.networks, &transitions, cx), Ok)?;
        start.set_drift(params.drift);
        let data = transitions.data(&start.model);
        let warm_up_epochs = if is_warm { 0 } else { params.warm_up_epochs };
        let learning_rate = if warm_up_epochs > 0 { params.warm_up_learning_rate } else { params.learning_rate };
        let settings = AdamSettings { learning_rate, weight_decay: params.weight_decay };
        let mut trainer = Trainer::new(start.model, start.adam, settings);
        let probe = cx.map_probe();
        let ramp_epochs = if is_warm { 0 } else { params.ramp_epochs };
        let steps_of_epoch = data.len().div_ceil(BATCH) as u64;
        let mut step = 0;
        for epoch in 0..params.epochs {
            let mut rng = cx.rng(("batches", epoch));
            let order = shuffled(data.len(), &mut rng);
            let mut loss = 0.0;
            if epoch == warm_up_epochs {
                trainer.set_learning_rate(params.learning_rate);
            }
            for which in order.chunks(BATCH) {
                let at = At::new(cx.round, epoch as u32, step);
                let threads = cx.threads.get();
                if epoch < warm_up_epochs {
                    let terms = trainer.warm_up_step(
                        threads,
                        &data,
                        which,
                        &params.warm_up,
                        epoch >= params.anchor_epochs,
                        &mut rng,
                    );
                    cx.record.scalars(
                        topic::TRAIN_WARM_UP,
                        at,
                        &[
                            ("encode_decode", terms.encode_decode),
                            ("prediction", terms.prediction),
                            ("consistency", terms.consistency),
                            ("anchor", terms.anchor),
                        ],
                    );
                    loss = terms.prediction;
                } else {
                    let done = step - warm_up_epochs * steps_of_epoch;
                    let objective = params.objective_at(done, ramp_epochs * steps_of_epoch, regularizer.as_deref());
                    let terms = trainer.step(threads, &data, which, &objective, &mut rng);
                    record(cx, at, &terms, &objective.weights);
                    loss = terms.deterministic;
                }
                step += 1;
            }
            if epoch % params.map_every == 0 || epoch + 1 == params.epochs {
                let at = At::new(cx.round, epoch as u32, step - 1);
                probe.record(&trainer.model, cx.record, at);
                pictures(cx, at, &transitions, &data, &trainer.model);
            }
            cx.tick(epoch + 1, params.epochs, &format!("decoding {loss:.1} nats"))?;
        }
        judge(cx, &trainer.model, &data, step);
        Ok(TrainedModel { model: trainer.model, adam: trainer.adam })
    }
}

impl Params {
    fn objective_at<'a>(&self, step: u64, ramp: u64, regularizer: Option<Regularizer<'a, f32>>) -> Objective<'a, f32> {
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
            guidance: None,
            regularizer,
        }
    }
}

fn shuffled(count: usize, rng: &mut crate::rng::Rng) -> Vec<u32> {
    let mut order: Vec<u32> = (0..count as u32).collect();
    noise::shuffle(rng, &mut order);
    order
}

/// A model with random weights whose widths suit the task.
fn fresh(networks: Networks, transitions: &Transitions, cx: &StageCx<'_>) -> anyhow::Result<TrainedModel> {
    let mut sizes = match cx.task.env {
        EnvName::Planar => Sizes::planar(),
        EnvName::SwingUp => Sizes::swing_up(),
        EnvName::CartPole => Sizes::cart_pole(),
        // Fewer links have fewer torques.
        EnvName::ThreePole => Sizes { action: transitions.action_dim, ..Sizes::three_pole() },
    };
    if networks == Networks::Dense {
        sizes = Sizes { convolution: None, encoder: [256; 2], decoder: [256; 2], ..sizes };
    }
    anyhow::ensure!(!transitions.is_empty(), "there are no transitions to learn from");
    let background = background(&transitions.frames(), transitions.pixels());
    let model = LceModel::new(sizes, background, &mut cx.rng("weights"));
    let adam = Adam::new(model.arena.len());
    Ok(TrainedModel { model, adam })
}

type Owned<'a> = Box<dyn Fn(usize, &[f32], f32, &mut [f32]) -> f32 + Sync + 'a>;

/// L_reg, where it has a weight and a policy under an old encoder.
fn l_reg<'a>(params: &Params, inputs: &'a Inputs, transitions: &Transitions) -> Option<Owned<'a>> {
    let (Some(old), Some(policy)) = (&inputs.warm_start, &inputs.policy) else { return None };
    if params.lambda.regularizer == 0.0 {
        return None;
    }
    let codes = old.model.encode_means(&old.model.pictures(&transitions.observations));
    let goals = old.model.encode_means(&old.model.pictures(&transitions.goals));
    let n = old.model.sizes.latent;
    let goal_codes: Vec<f32> =
        transitions.goal_index.iter().flat_map(|&g| &goals[g as usize * n..][..n]).copied().collect();
    let regularizer = PolicyRegularizer::new(policy, &codes, &goal_codes);
    Some(Box::new(move |transition, z, weight, d_z| regularizer.at(transition, z, weight, d_z)))
}

fn record(cx: &mut StageCx<'_>, at: At, terms: &Terms, weights: &Weights) {
    cx.record.scalars(
        topic::TRAIN_LCE,
        at,
        &[
            ("total", terms.total(weights)),
            ("reconstruction", terms.reconstruction),
            ("consistency", terms.consistency()),
            ("kl_backward", terms.kl_backward),
            ("entropy", terms.entropy),
            ("log_density", terms.log_density),
            ("curvature", terms.curvature),
            ("encode_decode", terms.encode_decode),
            ("deterministic", terms.deterministic),
            ("prior", terms.prior),
            ("regularizer", terms.regularizer),
            ("anchor", terms.anchor),
            ("consistency_weight", weights.consistency),
        ],
    );
}

/// An observation beside its reconstruction, and the prediction of the next.
fn pictures(cx: &mut StageCx<'_>, at: At, transitions: &Transitions, data: &Data, model: &LceModel) {
    let which = (at.epoch as usize * 37) % data.len();
    let (height, width) = transitions.picture;
    let x = &transitions.observations[which * transitions.pixels()..][..transitions.pixels()];
    let z = model.encode_means(&model.pictures(x));
    let u = &data.actions[which * data.action_dim..][..data.action_dim];
    let next = model.predict_mean(&z, u);
    let grey = |probabilities: Vec<f32>| probabilities.iter().map(|p| (p * 255.0) as u8).collect::<Vec<u8>>();
    let (height, width) = (height as u32, width as u32);
    cx.record.picture(topic::PICTURE_OBSERVATION, at, height, width, x);
    cx.record.picture(topic::PICTURE_RECONSTRUCTION, at, height, width, &grey(model.decode(&z)));
    cx.record.picture(topic::PICTURE_PREDICTION, at, height, width, &grey(model.decode(&next)));
}

/// Detectors that need no true state: a collapsed or a folded map is told at once.
fn judge(cx: &mut StageCx<'_>, model: &LceModel, data: &Data, step: u64) {
    let found = detectors::of(model, data);
    cx.figure("code_spread", found.spread);
    cx.figure("action_alignment", found.alignment);
    for sentence in found.sentences() {
        cx.record.log(At::new(cx.round, 0, step), Level::Warning, &sentence);
        cx.say(&sentence);
    }
}
