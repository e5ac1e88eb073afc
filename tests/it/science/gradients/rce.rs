//! The loss of RCE. Its bound is checked beside the code, where B's Gaussians are at hand.

use carl_pipe::lce::{
    LceModel, TransitionBatch,
    rce::{RceLoss, RceTerms, RceWorkspace},
};

use super::{
    cases::{Case, SAMPLES, locally_linear_cases, some_of},
    check,
};

fn run(case: &Case, arena: &[f64], loss: &RceLoss) -> (RceTerms, Vec<f64>) {
    let model = LceModel { arena: arena.to_vec(), ..case.model.clone() };
    let mut workspace = RceWorkspace::new(&model, SAMPLES + 2);
    let Case { pictures: images, pairs, x, actions, noise, .. } = case;
    let noise = &noise[..SAMPLES * RceWorkspace::noise_width(&model)];
    let terms = workspace.step(1, &model, loss, &TransitionBatch { images, pairs, x, actions, noise });
    (terms, workspace.gradient().to_vec())
}

fn total(case: &Case, arena: &[f64], loss: &RceLoss) -> f64 {
    run(case, arena, loss).0.total(loss)
}

#[test]
fn the_gradient_of_rces_loss_and_of_each_of_its_terms_equals_finite_differences() {
    let none = RceLoss { anchor_scale: 0.8, ..RceLoss::default() };
    for case in locally_linear_cases() {
        for (loss, each) in [
            (RceLoss { reconstruction: 0.9, consistency: 0.7, anchor: 0.5, ..none }, case.each),
            (RceLoss { reconstruction: 1.0, ..none }, 3),
            (RceLoss { consistency: 1.0, ..none }, 3),
            (RceLoss { anchor: 1.0, ..none }, 3),
        ] {
            let gradient = run(&case, &case.model.arena, &loss).1;
            assert!(gradient.iter().any(|&g| g != 0.0));
            for (layer, which) in some_of(&case.model.nets.layout.layers, each) {
                let what = format!("{loss:?}: {layer}");
                check(&what, &case.model.arena, &gradient, &which, |arena| total(&case, arena, &loss));
            }
        }
    }
}
