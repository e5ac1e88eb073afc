//! Learns the representation: encoder, dynamics, decoder and backward dynamics (paper, lines 3-7 of the CARL algorithm).

mod params;

use self::params::{LossName, Networks, Params, Slopes};
use super::{Stage, StageCx, inputs};
use crate::{
    artifact::{TrainedModel, Transitions},
    control::{
        Agent,
        guidance::{Seen, Spread},
        regularizer::PolicyRegularizer,
    },
    env::EnvName,
    lce::{
        LceModel, Sizes, detectors,
        model::background,
        objective::{Terms, Weights},
        refit::refit,
        trainer::{BATCH, Data, Trainer},
    },
    nn::{
        adam::{Adam, AdamSettings},
        noise,
        pictures::Squares,
    },
    record::{At, Level, topic},
};

inputs! {
    pub(super) struct Inputs {
        /// what to learn from
        transitions: Vec<Transitions>,
        /// the model to go on with; without one, training starts afresh, with a warm-up
        warm_start: Option<TrainedModel>,
        /// the policy that L_reg keeps
        policy: Option<Agent>,
        /// the agent, of `warm_start`'s latent space, whose TD errors weigh L_p and L_c in value-guided CARL
        value: Option<Agent>,
    }
}

pub(super) struct TrainLce;

impl Stage for TrainLce {
    const KIND: &'static str = "train_lce";
    /// 2: gradients of convolutional encoders are summed over what lit pixels reach.
    const VERSION: u32 = 2;
    const ABOUT: &'static str =
        "encoder, dynamics, decoder and backward dynamics by the loss of CARL, value-guided or not, or PCC";
    type Params = Params;
    type Inputs = Inputs;
    type Output = TrainedModel;

    fn run(params: &Params, inputs: Inputs, cx: &mut StageCx<'_>) -> anyhow::Result<TrainedModel> {
        let transitions = Transitions::concat(&inputs.transitions)?;
        let is_warm = inputs.warm_start.is_some();
        let regularizer = l_reg(params, &inputs, &transitions);
        let guidance = value_guided(params, &inputs, &transitions, cx)?;
        let mut start = inputs.warm_start.clone().map_or_else(|| fresh(params, &transitions, cx), Ok)?;
        let has_slopes = start.model.nets.slopes.is_some();
        anyhow::ensure!(
            has_slopes == (params.slopes == Slopes::Amortized),
            "`slopes` differs from what the model of `warm_start` was trained with"
        );
        start.set_drift(params.drift);
        let data = transitions.data(&start.model);
        let warm_up_epochs = if is_warm { 0 } else { params.warm_up_epochs };
        let learning_rate = if warm_up_epochs > 0 { params.warm_up_learning_rate } else { params.learning_rate };
        let settings = AdamSettings { learning_rate, weight_decay: params.weight_decay };
        let mut trainer = Trainer::new(start.model, start.adam, settings);
        if trainer.model.sizes.squares.is_some() {
            trainer.set_dropout(params.input_dropout);
        }
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
                    let ramp = ramp_epochs * steps_of_epoch;
                    let objective = params.objective_at(done, ramp, regularizer.as_deref(), guidance.as_deref());
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
        if params.refit_steps > 0 && params.slopes == Slopes::Exact {
            let codes = trainer.model.encode(&data.pictures);
            let rng = &mut cx.rng("refit");
            let (steps, learning_rate) = (params.refit_steps, params.warm_up_learning_rate);
            refit(&mut trainer.model, &codes, &data.actions, steps, learning_rate, rng);
        }
        judge(cx, &trainer.model, &transitions, (params.warm_up.scale, !is_warm), step);
        Ok(TrainedModel { model: trainer.model, adam: trainer.adam })
    }
}

fn shuffled(count: usize, rng: &mut crate::rng::Rng) -> Vec<u32> {
    let mut order: Vec<u32> = (0..count as u32).collect();
    noise::shuffle(rng, &mut order);
    order
}

/// A model with random weights whose widths suit the task.
fn fresh(params: &Params, transitions: &Transitions, cx: &StageCx<'_>) -> anyhow::Result<TrainedModel> {
    let sizes = match cx.task.env {
        EnvName::Planar => Sizes::planar(),
        EnvName::SwingUp => Sizes::swing_up(),
        EnvName::CartPole => Sizes::cart_pole(),
        // Fewer links have fewer torques.
        EnvName::ThreePole => Sizes { action: transitions.action_dim, ..Sizes::three_pole() },
    };
    let mut sizes = Sizes { slopes: params.slopes == Slopes::Amortized, ..sizes };
    if params.networks == Networks::Squares {
        let ((rows, columns), side) = (transitions.picture, params.square as usize);
        anyhow::ensure!(
            rows % side == 0 && columns % side == 0,
            "pictures of {rows} x {columns} pixels cannot be cut into squares of {side}: change `square`"
        );
        let squares = Squares { columns, side };
        let (hidden, backward) = ([128; 2], [10, 10, 50, 100]);
        sizes =
            Sizes { convolution: None, squares: Some(squares), encoder: hidden, decoder: hidden, backward, ..sizes };
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
    let regularizer = PolicyRegularizer::new(policy, &codes, &goal_codes(&old.model, transitions));
    Some(Box::new(move |transition, z, weight, d_z| regularizer.at(transition, z, weight, d_z)))
}

/// Means of E(·|x_g) of every transition's goal.
fn goal_codes(model: &LceModel, transitions: &Transitions) -> Vec<f32> {
    let goals = model.encode_means(&model.pictures(&transitions.goals));
    let n = model.sizes.latent;
    transitions.goal_index.iter().flat_map(|&g| &goals[g as usize * n..][..n]).copied().collect()
}

/// Share of the transitions that value-guided weights should at least be worth.
const FEW: f64 = 0.1;

/// The weights of L_p and L_c in value-guided CARL, from the agent and the encoder of the round before.
fn value_guided(
    params: &Params,
    inputs: &Inputs,
    transitions: &Transitions,
    cx: &mut StageCx<'_>,
) -> anyhow::Result<Option<Vec<f32>>> {
    let Some(agent) = &inputs.value else { return Ok(None) };
    anyhow::ensure!(params.objective == LossName::ValueGuided, "the input `value` goes with `value_guided` alone");
    let Some(old) = &inputs.warm_start else {
        anyhow::bail!("the input `value` needs `warm_start`, where its codes are")
    };
    let model = &old.model;
    let encode = |frames: &[u8]| model.encode(&model.pictures(frames));
    let (now, next) = (encode(&transitions.observations), encode(&transitions.next_observations));
    let goals = goal_codes(model, transitions);
    let seen = Seen { now: &now, next: &next, actions: &transitions.actions, goals: &goals };
    let errors = params.guidance.td_errors(agent, &seen, &mut cx.rng("guidance"));
    let weights = params.guidance.weights(&errors);
    record_guidance(cx, &errors, &weights);
    Ok(Some(weights))
}

/// How far the weights are from each other, and a word where few transitions have most of it.
fn record_guidance(cx: &mut StageCx<'_>, errors: &[f32], weights: &[f32]) {
    let spread = Spread::of(weights);
    let mean = errors.iter().map(|&error| f64::from(error)).sum::<f64>() / errors.len() as f64;
    let at = At::new(cx.round, 0, 0);
    let effective = spread.effective_share * weights.len() as f64;
    let curves = [
        ("effective_samples", effective),
        ("effective_share", spread.effective_share),
        ("smallest_weight", spread.smallest),
        ("largest_weight", spread.largest),
        ("mean_td_error", mean),
    ];
    cx.record.scalars(topic::TRAIN_GUIDANCE, at, &curves);
    cx.figure("effective_share", spread.effective_share);
    cx.figure("largest_weight", spread.largest);
    if spread.effective_share < FEW {
        let sentence = format!(
            "value-guided weights are worth {effective:.0} of {} transitions; a lower `guidance.temperature` spreads them",
            weights.len()
        );
        warn(cx, at, &sentence);
    }
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

/// Says a sentence in the recording and on the terminal.
fn warn(cx: &mut StageCx<'_>, at: At, sentence: &str) {
    cx.record.log(at, Level::Warning, sentence);
    cx.say(sentence);
}

/// Pictures that detectors look at: the first, which come from everywhere.
const JUDGED: usize = 1024;

/// Detectors that need no true state: a collapsed or a folded map, or a misplaced goal, is told at once.
fn judge(
    cx: &mut StageCx<'_>,
    model: &LceModel,
    transitions: &Transitions,
    (scale, is_first_round): (f64, bool),
    step: u64,
) {
    let judged = transitions.len().min(JUDGED) * transitions.pixels();
    let pictures = model.pictures(&transitions.observations[..judged]);
    let found = detectors::of(model, &pictures, &model.pictures(&transitions.goals));
    cx.figure("code_spread", found.spread);
    cx.figure("action_alignment", found.alignment);
    cx.figure("goal_rank", found.goal_rank());
    for sentence in found.sentences(scale, is_first_round) {
        warn(cx, At::new(cx.round, 0, step), &sentence);
    }
}
