//! What a training of the representation records.

use crate::{
    artifact::Transitions,
    lce::{
        LceModel,
        objective::{Terms, Weights},
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

/// One observation, its reconstruction and the prediction of the next.
pub(super) fn images(cx: &mut StageCx<'_>, at: At, transitions: &Transitions, model: &LceModel) {
    let which = (at.epoch as usize * 37) % transitions.len();
    let (height, width) = transitions.picture;
    let x = &transitions.observations[which * transitions.pixels()..][..transitions.pixels()];
    let z = model.encode_means(&model.pictures(x));
    let u = &transitions.actions[which * transitions.action_dim..][..transitions.action_dim];
    let next = model.predict_mean(&z, u);
    let grey = |probabilities: Vec<f32>| probabilities.iter().map(|p| (p * 255.0) as u8).collect::<Vec<u8>>();
    let (height, width) = (height as u32, width as u32);
    cx.record.picture(topic::PICTURE_OBSERVATION, at, height, width, x);
    cx.record.picture(topic::PICTURE_RECONSTRUCTION, at, height, width, &grey(model.decode(&z)));
    cx.record.picture(topic::PICTURE_PREDICTION, at, height, width, &grey(model.decode(&next)));
}
