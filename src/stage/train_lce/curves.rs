//! What a training of the representation records.

use crate::{
    artifact::Transitions,
    lce::{
        LceModel,
        e2c::{E2cLoss, E2cTerms},
        objective::{Terms, Weights},
        pc3::{Pc3Loss, Pc3Terms},
        rce::{RceLoss, RceTerms},
        warm_up::WarmUpTerms,
    },
    record::{At, topic},
    stage::StageCx,
};

/// The terms of the warm-up's loss.
pub(super) fn warm_up(cx: &mut StageCx<'_>, at: At, terms: &WarmUpTerms) {
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
}

/// The terms of the loss.
pub(super) fn loss(cx: &mut StageCx<'_>, at: At, terms: &Terms, weights: &Weights) {
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

/// The terms of PC3's loss.
pub(super) fn pc3(cx: &mut StageCx<'_>, at: At, terms: &Pc3Terms, loss: &Pc3Loss) {
    cx.record.scalars(
        topic::TRAIN_LCE,
        at,
        &[
            ("total", terms.total(loss)),
            ("nce", terms.nce),
            ("consistency", terms.consistency),
            ("curvature", terms.curvature),
            ("center", terms.center),
            ("anchor", terms.anchor),
            ("consistency_weight", loss.consistency),
        ],
    );
}

/// The terms of E2C's loss.
pub(super) fn e2c(cx: &mut StageCx<'_>, at: At, terms: &E2cTerms, loss: &E2cLoss) {
    cx.record.scalars(
        topic::TRAIN_LCE,
        at,
        &[
            ("total", terms.total(loss)),
            ("encode_decode", terms.encode_decode),
            ("prediction", terms.prediction),
            ("prior", terms.prior),
            ("transition_kl", terms.transition_kl),
            ("anchor", terms.anchor),
            ("consistency_weight", loss.transition_kl),
        ],
    );
}

/// The terms of RCE's loss.
pub(super) fn rce(cx: &mut StageCx<'_>, at: At, terms: &RceTerms, loss: &RceLoss) {
    cx.record.scalars(
        topic::TRAIN_LCE,
        at,
        &[
            ("total", terms.total(loss)),
            ("reconstruction", terms.reconstruction),
            ("consistency", terms.consistency()),
            ("kl_backward", terms.kl_backward),
            ("entropy", terms.entropy),
            ("log_density", terms.log_density),
            ("anchor", terms.anchor),
            ("consistency_weight", loss.consistency),
        ],
    );
}

/// One observation; if the model `decodes`, also its reconstruction and the prediction of the next.
pub(super) fn images(cx: &mut StageCx<'_>, at: At, transitions: &Transitions, model: &LceModel, decodes: bool) {
    let which = (at.epoch as usize * 37) % transitions.len();
    let x = &transitions.observations[which * transitions.pixels()..][..transitions.pixels()];
    cx.picture(topic::PICTURE_OBSERVATION, at, x);
    if !decodes {
        return;
    }
    let z = model.encode_means(&model.pictures(x));
    let u = &transitions.actions[which * transitions.action_dim..][..transitions.action_dim];
    let next = model.predict_mean(&z, u);
    let grey = |probabilities: Vec<f32>| probabilities.iter().map(|p| (p * 255.0) as u8).collect::<Vec<u8>>();
    cx.picture(topic::PICTURE_RECONSTRUCTION, at, &grey(model.decode(&z)));
    cx.picture(topic::PICTURE_PREDICTION, at, &grey(model.decode(&next)));
}
