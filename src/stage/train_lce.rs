//! Learns the representation: encoder, dynamics, decoder and backward dynamics (paper, lines 3-7 of the CARL algorithm).

mod lesson;
mod params;

use self::{
    lesson::{Lesson, OwnedRegularizer},
    params::{LossName, Params},
};
use super::{Stage, StageCx, inputs};
use crate::{
    artifact::{TrainedModel, Transitions},
    control::{
        Agent,
        guidance::{LatentTransitions, Spread},
        regularizer::PolicyRegularizer,
    },
    lce::{
        LceModel,
        map_checks::{self, MapChecks},
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
        let regularizer = l_reg(params, &inputs, &transitions);
        let guidance = value_guided(params, &inputs, &transitions, cx)?;
        let mut lesson = Lesson { params, transitions: &transitions, regularizer, guidance, epoch: 0, step: 0 };
        let is_first_round = inputs.warm_start.is_none();
        let mut trained = match inputs.warm_start.clone() {
            Some(warm) => lesson.go_on(warm, cx)?,
            None => lesson.begin(0, params.epochs, cx)?,
        };
        let mut found = judge(&trained.model, &transitions);
        let scale = params.warm_up.scale;
        let (mut restarts, mut stays) = (0, 0);
        while restarts < params.restarts
            && let Some(fault) = found.fault(scale)
        {
            restarts += 1;
            let again = format!("training begins again with other weights ({restarts} of {})", params.restarts);
            warn(cx, lesson.now(cx.round), &format!("{fault}; {again}"));
            let besides = if is_first_round { 0 } else { params.warm_up_epochs + params.ramp_epochs };
            let other = lesson.begin(restarts, besides + params.epochs, cx)?;
            let found_there = judge(&other.model, &transitions);
            if found_there.score(scale) > found.score(scale) {
                (trained, found, stays) = (other, found_there, restarts);
            }
        }
        if restarts > stays {
            let sentence = format!("the map of training {} of {} stays", stays + 1, restarts + 1);
            warn(cx, lesson.now(cx.round), &sentence);
        }
        // The data of the first round lie far from the goals, so no goal is suspect yet.
        trained.suspect_goals = if is_first_round { Vec::new() } else { found.suspect_goals() };
        let goals = trained.suspect_goals.iter().map(|&goal| found.why_suspect(goal));
        for sentence in found.fault(scale).into_iter().chain(goals) {
            warn(cx, lesson.now(cx.round), &sentence);
        }
        cx.metric("restarts", restarts as f64);
        cx.metric("code_spread", found.spread);
        cx.metric("action_alignment", found.alignment);
        cx.metric("goal_rank", found.goal_rank());
        Ok(trained)
    }
}

/// L_reg, where it has a weight and a policy under an old encoder.
fn l_reg<'a>(params: &Params, inputs: &'a Inputs, transitions: &Transitions) -> Option<OwnedRegularizer<'a>> {
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
    let latent = LatentTransitions { now: &now, next: &next, actions: &transitions.actions, goals: &goals };
    let errors = params.guidance.td_errors(agent, &latent, &mut cx.rng("guidance"));
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
    cx.metric("effective_share", spread.effective_share);
    cx.metric("largest_weight", spread.largest);
    if spread.effective_share < FEW {
        let sentence = format!(
            "value-guided weights are worth {effective:.0} of {} transitions; a lower `guidance.temperature` spreads them",
            weights.len()
        );
        warn(cx, at, &sentence);
    }
}

/// Says a sentence in the recording and on the terminal.
fn warn(cx: &mut StageCx<'_>, at: At, sentence: &str) {
    cx.record.log(at, Level::Warning, sentence);
    cx.say(sentence);
}

/// Images that the map checks use: the first ones, which come from all places.
const JUDGED: usize = 1024;

fn judge(model: &LceModel, transitions: &Transitions) -> MapChecks {
    let judged = transitions.len().min(JUDGED) * transitions.pixels();
    let pictures = model.pictures(&transitions.observations[..judged]);
    map_checks::check(model, &pictures, &model.pictures(&transitions.goals))
}
