//! The warm-up loss, the whole objective and its terms.

use carl_pipe::{
    lce::{
        LceModel,
        objective::{Batch, Regularizer, Terms, Weights, Workspace},
        warm_up::{WarmUp, WarmUpBatch, WarmUpWorkspace},
    },
    nn::heads,
};

use super::{
    cases::{Case, SAMPLES, amortized_case, case, drifting_case, every_case, locally_linear_cases, some_of},
    check, dot,
};

#[test]
fn the_gradient_of_the_whole_warm_up_equals_finite_differences() {
    let settings = WarmUp { sigma: 0.4, scale: 0.8, anchor: 3.0, huber_delta: 1.5, shrink: 0.05 };
    for case in every_case().into_iter().chain(locally_linear_cases()) {
        let latent = case.model.sizes.latent;
        let run = |arena: &[f64]| {
            let model = LceModel { arena: arena.to_vec(), ..case.model.clone() };
            let mut workspace = WarmUpWorkspace::new(&model, SAMPLES);
            let noise = &case.noise[..SAMPLES * 2 * latent];
            let batch =
                WarmUpBatch { images: &case.pictures, pairs: &case.pairs, actions: &case.actions, noise, decode: true };
            let terms = workspace.step(1, &model, &settings, &batch);
            // What the terms leave out: the pull of codes towards zero and of the encoder's noise towards sigma.
            let codes = model.encode(&case.pictures);
            let pulls = codes.chunks_exact(2 * latent).map(|code| {
                let (mean, log_sigma) = heads::halves(code);
                let off = log_sigma.iter().map(|l| (l - settings.sigma.ln()).powi(2)).sum::<f64>();
                settings.shrink * dot(mean, mean) + off
            });
            let pulls = pulls.sum::<f64>() / SAMPLES as f64;
            let total = terms.encode_decode + terms.prediction + terms.consistency + terms.anchor + pulls;
            (total, workspace.gradient().to_vec())
        };
        let gradient = run(&case.model.arena).1;
        for (layer, which) in some_of(&case.model.nets.layout.layers, case.each) {
            check(&layer, &case.model.arena, &gradient, &which, |arena| run(arena).0);
        }
        for (name, layer) in &case.model.nets.layout.layers {
            let is_idle = gradient[layer.at..layer.at + layer.len()].iter().all(|&g| g == 0.0);
            // The warm-up looks neither back nor at slopes.
            assert_eq!(is_idle, name.starts_with("backward.") || name == "dynamics.slopes", "{name}");
        }
    }
}

/// A made-up regularizer: sum (z - 0.2)^2 (1 + sample).
fn pull(sample: usize, z: &[f64], weight: f64, d_z: &mut [f64]) -> f64 {
    let steep = 1.0 + sample as f64;
    for (d_z, z) in d_z.iter_mut().zip(z) {
        *d_z += weight * 2.0 * steep * (z - 0.2);
    }
    z.iter().map(|z| steep * (z - 0.2).powi(2)).sum()
}

fn objective(case: &Case, arena: &[f64], weights: &Weights, guided: bool) -> (f64, Terms, Vec<f64>) {
    let model = LceModel { arena: arena.to_vec(), ..case.model.clone() };
    let mut workspace = Workspace::new(&model, SAMPLES);
    let batch = Batch {
        images: &case.pictures,
        pairs: &case.pairs,
        x: &case.x,
        actions: &case.actions,
        noise: &case.noise,
        curvature_sigma: 0.3,
        anchor_scale: 0.8,
        guidance: guided.then_some(&case.guidance),
        regularizer: Some(&pull as Regularizer<'_, f64>),
    };
    let terms = workspace.step(1, &model, weights, &batch);
    // Guidance weighs L_p and L_c of every sample, and nothing else.
    let total = (0..SAMPLES).map(|i| {
        let terms = workspace.sample_terms(i);
        let guided_part =
            Weights { reconstruction: weights.reconstruction, consistency: weights.consistency, ..Weights::default() };
        let rest = Weights { reconstruction: 0.0, consistency: 0.0, ..*weights };
        let guidance = if guided { case.guidance[i] } else { 1.0 };
        guidance * terms.total(&guided_part) + terms.total(&rest)
    });
    (total.sum::<f64>() / SAMPLES as f64, terms, workspace.gradient().to_vec())
}

fn every_weight() -> Weights {
    Weights {
        reconstruction: 1.0,
        consistency: 8.0,
        curvature: 0.0,
        encode_decode: 0.4,
        prior: 0.3,
        deterministic: 0.6,
        regularizer: 0.5,
        anchor: 0.7,
    }
}

#[test]
fn the_gradient_of_the_whole_objective_equals_finite_differences() {
    for case in every_case() {
        for guided in [false, true] {
            let run = |arena: &[f64]| objective(&case, arena, &every_weight(), guided);
            let (total, terms, gradient) = run(&case.model.arena);
            if !guided {
                assert!((terms.total(&every_weight()) - total).abs() < 1e-10);
            }
            for (layer, which) in some_of(&case.model.nets.layout.layers, case.each) {
                check(&layer, &case.model.arena, &gradient, &which, |arena| run(arena).0);
            }
        }
    }
}

#[test]
fn the_gradient_of_every_single_term_equals_finite_differences() {
    let case = case(2, 2);
    let none = Weights::default();
    for (name, weights) in [
        ("reconstruction", Weights { reconstruction: 1.0, ..none }),
        ("consistency", Weights { consistency: 1.0, ..none }),
        ("encode_decode", Weights { encode_decode: 1.0, ..none }),
        ("prior", Weights { prior: 1.0, ..none }),
        ("deterministic", Weights { deterministic: 1.0, ..none }),
        ("regularizer", Weights { regularizer: 1.0, ..none }),
        ("anchor", Weights { anchor: 1.0, ..none }),
    ] {
        let gradient = objective(&case, &case.model.arena, &weights, false).2;
        for (layer, which) in some_of(&case.model.nets.layout.layers, 3) {
            let what = format!("{name}: {layer}");
            check(&what, &case.model.arena, &gradient, &which, |arena| objective(&case, arena, &weights, false).0);
        }
    }
}

/// Nothing but the anchor moves the drift, and through it the drift moves E of x.
#[test]
fn the_anchor_with_a_drift_equals_finite_differences() {
    let case = drifting_case();
    let anchor = Weights { anchor: 1.0, ..Weights::default() };
    let run = |arena: &[f64], weights: &Weights| objective(&case, arena, weights, false);
    let gradient = run(&case.model.arena, &anchor).2;
    for (layer, which) in some_of(&case.model.nets.layout.layers, case.each) {
        check(&layer, &case.model.arena, &gradient, &which, |arena| run(arena, &anchor).0);
    }
    let (_, layer) = case.model.nets.layout.layers.last().expect("layers");
    let of_drift = layer.at..layer.at + layer.len();
    assert!(gradient[of_drift.clone()].iter().all(|&g| g != 0.0));
    let others = run(&case.model.arena, &Weights { anchor: 0.0, curvature: 0.9, ..every_weight() }).2;
    assert!(others[of_drift].iter().all(|&g| g == 0.0));
}

/// The points (z, u) of the curvature are detached, and z comes from the encoder: the dynamics alone have a gradient,
/// and moving their weights does not move the points.
#[test]
fn the_curvatures_gradient_equals_finite_differences_and_reaches_the_dynamics_alone() {
    for case in [case(2, 2), amortized_case()] {
        let weights = Weights { curvature: 1.0, ..Weights::default() };
        let gradient = objective(&case, &case.model.arena, &weights, false).2;
        assert!(gradient.iter().any(|&g| g != 0.0));
        for (layer, which) in some_of(&case.model.nets.layout.layers, 30) {
            if layer.starts_with("dynamics.") {
                check(&layer, &case.model.arena, &gradient, &which, |arena| objective(&case, arena, &weights, false).0);
            } else {
                assert!(which.iter().all(|&i| gradient[i] == 0.0), "{layer}");
            }
        }
    }
}

#[test]
fn gradients_of_terms_add_up() {
    let case = case(2, 2);
    let none = Weights::default();
    let every = Weights { curvature: 0.9, ..every_weight() };
    let of = |weights: &Weights| objective(&case, &case.model.arena, weights, false).2;
    let mut sum = vec![0.0; case.model.arena.len()];
    for single in [
        Weights { reconstruction: every.reconstruction, ..none },
        Weights { consistency: every.consistency, ..none },
        Weights { curvature: every.curvature, ..none },
        Weights { encode_decode: every.encode_decode, ..none },
        Weights { prior: every.prior, ..none },
        Weights { deterministic: every.deterministic, ..none },
        Weights { regularizer: every.regularizer, ..none },
        Weights { anchor: every.anchor, ..none },
    ] {
        sum.iter_mut().zip(of(&single)).for_each(|(sum, g)| *sum += g);
    }
    let largest = sum.iter().fold(0.0_f64, |m, g| m.max(g.abs()));
    assert!(of(&every).iter().zip(&sum).all(|(a, b)| (a - b).abs() < 1e-12 * largest));
}
