//! The ranges of the parameters of `train_lce`.

use super::params::{
    FramePatches, Lambda, LossName, Networks, Params, Refit, Slopes, UNBOUNDED, WarmUpSchedule, Widths,
};
use crate::{
    control::guidance::Guidance,
    lce::{Differences, pc3::Pc3, warm_up::WarmUp},
    nn::binary_images::{Deviation, Likelihood},
    stage::{MOST_COPIES, MOST_PASSES, MOST_STEPS, Refusal, above_zero, count, within},
};

/// The most transitions of one batch.
const MOST_SAMPLES_OF_A_BATCH: u64 = 512;

/// The most coordinates that one part of a code may have.
const MOST_COORDINATES: u64 = 64;

/// The widest layer that a file may ask for.
const WIDEST: u64 = 1 << 14;

/// The parameters that are out of range.
pub(super) fn out_of_range(params: &Params) -> Vec<Refusal> {
    let mut refusals = counts(params);
    within(&mut refusals, "ramp.from", params.ramp.from, 0.0, 1.0);
    networks(params.networks, &mut refusals);
    widths(params, &mut refusals);
    if let Likelihood::Gaussian(Deviation { sigma }) = params.likelihood {
        within(&mut refusals, "likelihood.gaussian.sigma", sigma, 1e-3, 1e3);
    }
    lambda(&params.lambda, &mut refusals);
    if params.lambda.regularizer > 0.0 && params.symmetries.change_something() {
        let why = "must be 0 with `symmetries`: L_reg knows the old policy's actions only in unchanged pictures";
        let help = "set it to 0, or give every symmetry the share 0";
        refusals.push(Refusal::new("lambda.regularizer", why).help(help));
    }
    within(&mut refusals, "weight_decay", params.weight_decay, 0.0, 1e6);
    above_zero(&mut refusals, "learning_rate", params.learning_rate);
    above_zero(&mut refusals, "curvature_sigma", params.curvature_sigma);
    within(&mut refusals, "least_alignment", params.least_alignment, 0.0, 1.0);
    warm_up(&params.warm_up, &mut refusals);
    match &params.objective {
        LossName::Carl | LossName::Pcc => {}
        LossName::ValueGuided(settings) => guidance(settings, &mut refusals),
        LossName::Pc3(settings) => pc3(settings, &params.lambda, &mut refusals),
        LossName::E2c | LossName::Rce => locally_linear(params, &mut refusals),
    }
    refusals
}

fn counts(params: &Params) -> Vec<Refusal> {
    let mut refusals = Vec::new();
    for (path, passes, fewest) in [
        ("epochs", params.epochs, 1),
        ("warm_up.epochs", params.warm_up.epochs, 0),
        ("warm_up.anchor_epochs", params.warm_up.anchor_epochs, 0),
        ("ramp.epochs", params.ramp.epochs, 0),
        ("map_every", params.map_every, 1),
    ] {
        count(&mut refusals, path, passes, fewest..=MOST_PASSES);
    }
    count(&mut refusals, "symmetric_copies", params.symmetric_copies, 1..=MOST_COPIES);
    count(&mut refusals, "restarts", params.restarts, 0..=1000);
    if let Slopes::Exact(Refit { refit_steps }) = params.slopes {
        count(&mut refusals, "slopes.exact.refit_steps", refit_steps, 0..=MOST_STEPS);
    }
    refusals
}

fn networks(networks: Networks, refusals: &mut Vec<Refusal>) {
    match networks {
        Networks::Paper => {}
        Networks::PooledPatches(patches) => {
            count(refusals, "networks.pooled_patches.side", patches.side, 1..=15);
            within(refusals, "networks.pooled_patches.dropout", patches.dropout, 0.0, 0.9);
        }
        Networks::SharedFrames(frames) => shared_frames(frames, refusals),
    }
}

fn widths(params: &Params, refusals: &mut Vec<Refusal>) {
    let Widths { latent, encoder, decoder, dynamics } = params.widths;
    latent.into_iter().for_each(|latent| count(refusals, "widths.latent", latent, 1..=2 * MOST_COORDINATES));
    if latent.is_some() && matches!(params.networks, Networks::SharedFrames(_)) {
        let refusal = Refusal::new("widths.latent", "does not go together with `networks = \"shared_frames\"`");
        refusals.push(refusal.help("set `networks.shared_frames.coordinates`"));
    }
    for (path, written) in [("widths.encoder", encoder), ("widths.decoder", decoder), ("widths.dynamics", dynamics)] {
        written.into_iter().flatten().for_each(|width| count(refusals, path, width, 1..=WIDEST));
    }
}

fn shared_frames(frames: FramePatches, refusals: &mut Vec<Refusal>) {
    let FramePatches { side, predicted_side, dropout, coordinates, differences } = frames;
    count(refusals, "networks.shared_frames.side", side, 1..=15);
    count(refusals, "networks.shared_frames.predicted_side", predicted_side, 1..=15);
    if side > 0 && !predicted_side.is_multiple_of(side) {
        let why = format!("must be a multiple of `networks.shared_frames.side`, {side}");
        refusals.push(Refusal::new("networks.shared_frames.predicted_side", why));
    }
    within(refusals, "networks.shared_frames.dropout", dropout, 0.0, 0.9);
    count(refusals, "networks.shared_frames.coordinates", coordinates, 1..=MOST_COORDINATES);
    match differences {
        Differences::None => {}
        Differences::Scaled { scale } => {
            within(refusals, "networks.shared_frames.differences.scaled.scale", scale, 1e-3, 1e3);
        }
        Differences::Mixed { scale, coordinates } => {
            within(refusals, "networks.shared_frames.differences.mixed.scale", scale, 1e-3, 1e3);
            let path = "networks.shared_frames.differences.mixed.coordinates";
            count(refusals, path, coordinates as u64, 1..=MOST_COORDINATES);
        }
    }
}

fn warm_up(warm_up: &WarmUpSchedule, refusals: &mut Vec<Refusal>) {
    let &WarmUpSchedule { learning_rate, loss: WarmUp { sigma, scale, anchor, huber_delta, shrink }, .. } = warm_up;
    for (path, value) in [
        ("warm_up.learning_rate", learning_rate),
        ("warm_up.loss.sigma", sigma),
        ("warm_up.loss.scale", scale),
        ("warm_up.loss.huber_delta", huber_delta),
    ] {
        above_zero(refusals, path, value);
    }
    within(refusals, "warm_up.loss.anchor", anchor, 0.0, 1e6);
    within(refusals, "warm_up.loss.shrink", shrink, 0.0, 1e6);
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
    within(refusals, "objective.value_guided.temperature", temperature, 0.0, 1e6);
    within(refusals, "objective.value_guided.discount", discount, 0.01, 1.0);
    count(refusals, "objective.value_guided.samples", samples, 1..=10_000);
    within(refusals, "objective.value_guided.bound", bound, 0.0, UNBOUNDED);
}

fn pc3(pc3: &Pc3, lambda: &Lambda, refusals: &mut Vec<Refusal>) {
    let &Pc3 { nce, center, sigma, batch } = pc3;
    within(refusals, "objective.pc3.nce", nce, 0.0, 1e6);
    within(refusals, "objective.pc3.center", center, 0.0, 1e6);
    above_zero(refusals, "objective.pc3.sigma", sigma);
    count(refusals, "objective.pc3.batch", batch, 2..=MOST_SAMPLES_OF_A_BATCH);
    let without = [
        ("lambda.encode_decode", lambda.encode_decode),
        ("lambda.prior", lambda.prior),
        ("lambda.prediction", lambda.prediction),
        ("lambda.regularizer", lambda.regularizer),
        ("lambda.deterministic", lambda.deterministic),
    ];
    must_be_zero("pc3", &without, refusals);
}

/// E2C and RCE.
fn locally_linear(params: &Params, refusals: &mut Vec<Refusal>) {
    let Lambda { encode_decode, prior, curvature, regularizer, deterministic, .. } = params.lambda;
    let without =
        [("lambda.curvature", curvature), ("lambda.regularizer", regularizer), ("lambda.deterministic", deterministic)];
    let objective = if params.objective == LossName::Rce { "rce" } else { "e2c" };
    must_be_zero(objective, &without, refusals);
    if params.objective == LossName::Rce {
        must_be_zero(objective, &[("lambda.encode_decode", encode_decode), ("lambda.prior", prior)], refusals);
    }
    if params.slopes == Slopes::Amortized {
        let why = format!("must be `exact` with `objective = \"{objective}\"`: its F puts out A and B itself");
        refusals.push(Refusal::new("slopes", why));
    }
}

/// Refuses weights of terms that an objective does not have.
fn must_be_zero(objective: &str, lambda: &[(&'static str, f64)], refusals: &mut Vec<Refusal>) {
    for &(path, _) in lambda.iter().filter(|(_, weight)| *weight > 0.0) {
        refusals.push(Refusal::new(
            path,
            format!("must be 0 with `objective = \"{objective}\"`: its loss has no such term"),
        ));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lce::pc3::Pc3;

    #[test]
    fn an_objective_refuses_the_weights_of_terms_that_it_does_not_have() {
        let with = |lambda: Lambda| Params { objective: LossName::Pc3(Pc3::default()), lambda, ..Params::default() };
        let refused = |params: &Params| out_of_range(params).into_iter().map(|it| it.path).collect::<Vec<_>>();
        let own = Lambda::of(&LossName::Pc3(Pc3::default()));
        assert_eq!(refused(&with(own.clone())), [""; 0]);
        assert_eq!(refused(&with(Lambda { prediction: 0.5, ..own.clone() })), ["lambda.prediction"]);
        assert_eq!(
            refused(&with(Lambda { prior: 0.5, deterministic: 1.0, ..own })),
            ["lambda.prior", "lambda.deterministic"]
        );
        assert_eq!(refused(&Params::default()), [""; 0], "CARL has these terms");
        let e2c = |lambda, slopes| Params { objective: LossName::E2c, lambda, slopes, ..Params::default() };
        let own = Lambda::of(&LossName::E2c);
        assert_eq!(refused(&e2c(own.clone(), Slopes::Exact(Refit::default()))), [""; 0]);
        assert_eq!(refused(&e2c(Lambda { curvature: 1.0, ..own }, Slopes::Amortized)), ["lambda.curvature", "slopes"]);
    }
}
