//! The ranges of the parameters of `train_lce`.

use super::params::{Lambda, Networks, Params, UNBOUNDED};
use crate::{
    control::guidance::Guidance,
    lce::warm_up::WarmUp,
    stage::{Refusal, above_zero, at_least_one, within},
};

/// The parameters that are out of range.
pub(super) fn out_of_range(params: &Params) -> Vec<Refusal> {
    let mut refusals = at_least_one("epochs", params.epochs);
    refusals.extend(at_least_one("map_every", params.map_every));
    within(&mut refusals, "ramp_from", params.ramp_from, 0.0, 1.0);
    networks(params, &mut refusals);
    lambda(&params.lambda, &mut refusals);
    within(&mut refusals, "weight_decay", params.weight_decay, 0.0, 1e6);
    within(&mut refusals, "warm_up.anchor", params.warm_up.anchor, 0.0, 1e6);
    within(&mut refusals, "warm_up.shrink", params.warm_up.shrink, 0.0, 1e6);
    let WarmUp { sigma, scale, huber_delta, .. } = params.warm_up;
    for (path, value) in [
        ("learning_rate", params.learning_rate),
        ("warm_up_learning_rate", params.warm_up_learning_rate),
        ("curvature_sigma", params.curvature_sigma),
        ("warm_up.sigma", sigma),
        ("warm_up.scale", scale),
        ("warm_up.outlier", huber_delta),
    ] {
        above_zero(&mut refusals, path, value);
    }
    guidance(&params.guidance, &mut refusals);
    refusals
}

fn networks(params: &Params, refusals: &mut Vec<Refusal>) {
    within(refusals, "square", params.square as f64, 1.0, 15.0);
    within(refusals, "input_dropout", params.input_dropout, 0.0, 0.9);
    if params.networks != Networks::PooledPatches && params.input_dropout > 0.0 {
        let why = "must be 0 without `networks = \"squares\"`".to_owned();
        refusals.push(Refusal { path: "input_dropout", why });
    }
}

fn lambda(lambda: &Lambda, refusals: &mut Vec<Refusal>) {
    let &Lambda { encode_decode, prior, prediction, consistency, curvature, regularizer, deterministic, anchor } =
        lambda;
    for (path, value) in [
        ("lambda.encode_decode", encode_decode),
        ("lambda.prior", prior),
        ("lambda.prediction", prediction),
        ("lambda.consistency", consistency),
        ("lambda.curvature", curvature),
        ("lambda.regularizer", regularizer),
        ("lambda.deterministic", deterministic),
        ("lambda.anchor", anchor),
    ] {
        within(refusals, path, value, 0.0, 1e6);
    }
}

fn guidance(guidance: &Guidance, refusals: &mut Vec<Refusal>) {
    let &Guidance { temperature, discount, samples, bound, .. } = guidance;
    within(refusals, "guidance.temperature", temperature, 0.0, 1e6);
    within(refusals, "guidance.discount", discount, 0.01, 1.0);
    within(refusals, "guidance.samples", samples as f64, 1.0, 1e4);
    within(refusals, "guidance.bound", bound, 0.0, UNBOUNDED);
}
