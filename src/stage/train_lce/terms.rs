//! The terms of the loss that come from an earlier policy: L_reg, and the weights of value-guided CARL.

use super::{
    Inputs,
    params::{LossName, Params},
};
use crate::{
    artifact::Transitions,
    control::{
        guidance::{LatentTransitions, Spread},
        regularizer::PolicyRegularizer,
    },
    lce::LceModel,
    record::{At, Level, topic},
    stage::{StageCx, fits},
};

/// L_reg and its gradient at the code of one transition.
pub(super) type OwnedRegularizer<'a> = Box<dyn Fn(usize, &[f32], f32, &mut [f32]) -> f32 + Sync + 'a>;

/// L_reg, if it has a weight, and the inputs hold a policy and the encoder of the policy's latent space.
pub(super) fn l_reg<'a>(
    params: &Params,
    inputs: &'a Inputs,
    transitions: &Transitions,
) -> anyhow::Result<Option<OwnedRegularizer<'a>>> {
    let (Some(old), Some(policy)) = (&inputs.warm_start, &inputs.policy) else { return Ok(None) };
    if params.lambda.regularizer == 0.0 {
        return Ok(None);
    }
    let codes = old.model.encode_means(&old.model.pictures(&transitions.observations));
    let codes = fits::finite_codes("warm_start", codes)?;
    let regularizer = PolicyRegularizer::new(policy, &codes, &goal_codes(&old.model, transitions));
    Ok(Some(Box::new(move |transition, z, weight, d_z| regularizer.at(transition, z, weight, d_z))))
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
pub(super) fn value_guided(
    params: &Params,
    inputs: &Inputs,
    transitions: &Transitions,
    cx: &mut StageCx<'_>,
) -> anyhow::Result<Option<Vec<f32>>> {
    let Some(agent) = &inputs.value else { return Ok(None) };
    let LossName::ValueGuided(guidance) = &params.objective else {
        anyhow::bail!("the input `value` goes with `objective = \"value_guided\"` alone")
    };
    let Some(old) = &inputs.warm_start else {
        anyhow::bail!("the input `value` needs `warm_start`, where its codes are")
    };
    let model = &old.model;
    let encode = |frames: &[u8]| model.encode(&model.pictures(frames));
    let (now, next) = (encode(&transitions.observations), encode(&transitions.next_observations));
    let goals = goal_codes(model, transitions);
    let latent = LatentTransitions { now: &now, next: &next, actions: &transitions.actions, goals: &goals };
    let errors = guidance.td_errors(agent, &latent, &mut cx.rng("guidance"));
    let weights = guidance.weights(&errors);
    anyhow::ensure!(
        weights.iter().all(|weight| weight.is_finite()),
        "a value-guided weight is not finite: the TD errors of input `value` reach {:e}",
        errors.iter().fold(0.0_f32, |most, error| most.max(error.abs()))
    );
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
            "value-guided weights are worth {effective:.0} of {} transitions; a lower `objective.value_guided.temperature` spreads them",
            weights.len()
        );
        cx.log(at, Level::Warning, &sentence);
    }
}
