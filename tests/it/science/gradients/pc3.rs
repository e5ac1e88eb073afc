//! The loss of PC3.

use carl_pipe::lce::{
    LceModel, TransitionBatch,
    dynamics::DynamicsPass,
    pc3::{Pc3Loss, Pc3Terms, Pc3Workspace},
};

use super::{
    cases::{Case, SAMPLES, amortized_case, case, drifting_case, every_case, some_of},
    check,
};

const EVERY_TERM: Pc3Loss = Pc3Loss {
    nce: 0.9,
    consistency: 0.6,
    curvature: 0.0,
    center: 0.4,
    anchor: 0.7,
    sigma: 0.2,
    curvature_sigma: 0.3,
    anchor_scale: 0.8,
};

fn run(case: &Case, arena: &[f64], loss: &Pc3Loss) -> (Pc3Terms, Vec<f64>) {
    let model = LceModel { arena: arena.to_vec(), ..case.model.clone() };
    let mut workspace = Pc3Workspace::new(&model, SAMPLES + 2);
    let Case { pictures: images, pairs, x, actions, noise, .. } = case;
    let noise = &noise[..SAMPLES * Pc3Workspace::noise_width(&model)];
    let terms = workspace.step(1, &model, loss, &TransitionBatch { images, pairs, x, actions, noise });
    (terms, workspace.gradient().to_vec())
}

fn total(case: &Case, arena: &[f64], loss: &Pc3Loss) -> f64 {
    run(case, arena, loss).0.total(loss)
}

#[test]
fn the_gradient_of_pc3s_loss_equals_finite_differences_and_passes_by_the_decoder() {
    for case in every_case() {
        let gradient = run(&case, &case.model.arena, &EVERY_TERM).1;
        for (layer, which) in some_of(&case.model.nets.layout.layers, case.each) {
            check(&layer, &case.model.arena, &gradient, &which, |arena| total(&case, arena, &EVERY_TERM));
            let is_idle = ["decoder.", "backward.", "dynamics.slopes"].iter().any(|name| layer.starts_with(name));
            assert!(!is_idle || which.iter().all(|&i| gradient[i] == 0.0), "{layer}");
        }
    }
}

#[test]
fn the_gradient_of_every_single_term_of_pc3_equals_finite_differences() {
    let none = Pc3Loss { sigma: 0.2, anchor_scale: 0.8, ..Pc3Loss::default() };
    for case in [case(2, 2), drifting_case()] {
        for loss in [
            Pc3Loss { nce: 1.0, ..none },
            Pc3Loss { consistency: 1.0, ..none },
            Pc3Loss { center: 1.0, ..none },
            Pc3Loss { anchor: 1.0, ..none },
        ] {
            let gradient = run(&case, &case.model.arena, &loss).1;
            assert!(gradient.iter().any(|&g| g != 0.0));
            for (layer, which) in some_of(&case.model.nets.layout.layers, 4) {
                let what = format!("{loss:?}: {layer}");
                check(&what, &case.model.arena, &gradient, &which, |arena| total(&case, arena, &loss));
            }
        }
    }
}

/// The points of L_cur are detached.
#[test]
fn the_curvature_of_pc3_moves_the_dynamics_alone() {
    let loss = Pc3Loss { curvature: 1.0, curvature_sigma: 0.4, ..Pc3Loss::default() };
    for case in [case(2, 2), amortized_case()] {
        let gradient = run(&case, &case.model.arena, &loss).1;
        assert!(gradient.iter().any(|&g| g != 0.0));
        for (layer, which) in some_of(&case.model.nets.layout.layers, 20) {
            if layer.starts_with("dynamics.") {
                check(&layer, &case.model.arena, &gradient, &which, |arena| total(&case, arena, &loss));
            } else {
                assert!(which.iter().all(|&i| gradient[i] == 0.0), "{layer}");
            }
        }
    }
}

/// F(·|z, u).
fn gaussian(model: &LceModel<f64>, z: &[f64], u: &[f64]) -> Vec<f64> {
    let mut gaussian = vec![0.0; 2 * z.len()];
    model.predict(&[z, u].concat(), &mut DynamicsPass::new(&model.nets.dynamics, 1, 1), &mut gaussian);
    gaussian
}

/// N(z; mean, sigma²), coordinate by coordinate.
fn density(z: &[f64], gaussian: &[f64]) -> f64 {
    let (mean, log_sigma) = gaussian.split_at(z.len());
    let each = (0..z.len()).map(|k| {
        let variance = (2.0 * log_sigma[k]).exp();
        (-(z[k] - mean[k]).powi(2) / (2.0 * variance)).exp() / (2.0 * std::f64::consts::PI * variance).sqrt()
    });
    each.product()
}

fn moved(at: &[f64], way: &[f64], length: f64) -> Vec<f64> {
    at.iter().zip(way).map(|(at, way)| at + length * way).collect()
}

/// Densities themselves instead of their logarithms, one network at a time, and a derivative by differences.
#[test]
fn the_terms_of_pc3_are_those_of_loops_over_single_samples() {
    for case in [case(2, 2), case(3, 1)] {
        let (model, loss) = (&case.model, Pc3Loss { curvature_sigma: 0.4, ..EVERY_TERM });
        let (n, a) = (model.sizes.latent, model.sizes.action);
        let width = 2 * n + a;
        let codes = model.encode_means(&case.pictures);
        let code = |image: u32| &codes[image as usize * n..][..n];
        let now: Vec<&[f64]> = case.pairs.iter().step_by(2).map(|&image| code(image)).collect();
        let action = |i: usize| &case.actions[i * a..][..a];
        let noise = |i: usize| &case.noise[i * width..][..width];
        let mut sums = Pc3Terms::<f64>::default();
        for i in 0..SAMPLES {
            let z_next = moved(code(case.pairs[2 * i + 1]), &noise(i)[..n], loss.sigma);
            let densities: Vec<f64> =
                (0..SAMPLES).map(|j| density(&z_next, &gaussian(model, now[j], action(j)))).collect();
            sums.nce -= (densities[i] / (densities.iter().sum::<f64>() / SAMPLES as f64) + 1e-8).ln();
            sums.consistency -= densities[i].ln();
            let (way, at) = (moved(&vec![0.0; n + a], &noise(i)[n..], 0.4), [now[i], action(i)].concat());
            let mean = |length: f64| {
                let z_u = moved(&at, &way, length);
                gaussian(model, &z_u[..n], &z_u[n..])
            };
            let (here, there, ahead, behind) = (mean(0.0), mean(1.0), mean(1e-6), mean(-1e-6));
            let residual = |k: usize| there[k] - here[k] - (ahead[k] - behind[k]) / 2e-6;
            sums.curvature += (0..n).map(|k| residual(k).powi(2)).sum::<f64>();
            let pushed = moved(now[i], action(i), loss.anchor_scale);
            let pushed = if a < n { [&pushed[..a.min(pushed.len())], &now[i][a..]].concat() } else { pushed };
            sums.anchor += moved(code(case.pairs[2 * i + 1]), &pushed, -1.0).iter().map(|r| r * r).sum::<f64>();
        }
        let mean = |k: usize| now.iter().map(|z| z[k]).sum::<f64>() / SAMPLES as f64;
        let center = (0..n).map(|k| mean(k).powi(2)).sum();
        let expected = Pc3Terms { center, ..sums.map(|sum| sum / SAMPLES as f64) };
        let (terms, _) = run(&case, &model.arena, &loss);
        for ((name, term), (_, expected)) in terms.named().into_iter().zip(expected.named()) {
            assert!((term - expected).abs() < 1e-7 * expected.abs().max(0.1), "{name}: {term}, not {expected}");
        }
    }
}

#[test]
fn nce_is_zero_where_all_pasts_look_alike_and_at_best_the_logarithm_of_their_number() {
    let mut case = case(2, 2);
    let loss = Pc3Loss { nce: 1.0, sigma: 1e-3, ..Pc3Loss::default() };
    let arena = case.model.arena.clone();
    let [.., (_, head)] = &case.model.nets.layout.layers[..].split_at(9).0 else { panic!("layers") };
    assert_eq!(head.at, case.model.nets.dynamics.net().layers[2].at);
    // F's means are z + 0, its deviations 1e4 or 1e-3; all codes are those of one image, or x' is x.
    let with_log_sigma = |log_sigma: f64, arena: &[f64]| {
        let mut arena = arena.to_vec();
        let (weights, biases) = head.w_b_mut(&mut arena);
        weights.fill(0.0);
        biases.copy_from_slice(&[0.0, 0.0, log_sigma, log_sigma]);
        arena
    };
    case.pairs = (0..SAMPLES as u32).flat_map(|i| [i, i]).collect();
    let blind = run(&case, &with_log_sigma(1e4_f64.ln(), &arena), &loss).0.nce;
    assert!(blind.abs() < 1e-6, "{blind}");
    let sharp = run(&case, &with_log_sigma(1e-3_f64.ln(), &arena), &loss).0.nce;
    assert!((sharp + (SAMPLES as f64).ln()).abs() < 1e-6, "{sharp}");
}
