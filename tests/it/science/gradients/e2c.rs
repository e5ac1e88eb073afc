//! The loss of E2C, and its locally linear dynamics.

use carl_pipe::{
    lce::{
        LceModel, TransitionBatch,
        e2c::{E2cLoss, E2cTerms, E2cWorkspace},
    },
    nn::mlp::Pass,
};

use super::{
    cases::{Case, SAMPLES, locally_linear_cases, some_of},
    check,
};

const EVERY_TERM: E2cLoss =
    E2cLoss { encode_decode: 0.4, prediction: 0.9, prior: 0.3, transition_kl: 0.6, anchor: 0.7, anchor_scale: 0.8 };

fn run(case: &Case, arena: &[f64], loss: &E2cLoss) -> (E2cTerms, Vec<f64>) {
    let model = LceModel { arena: arena.to_vec(), ..case.model.clone() };
    let mut workspace = E2cWorkspace::new(&model, SAMPLES + 2);
    let Case { pictures: images, pairs, x, actions, noise, .. } = case;
    let noise = &noise[..SAMPLES * E2cWorkspace::noise_width(&model)];
    let terms = workspace.step(1, &model, loss, &TransitionBatch { images, pairs, x, actions, noise });
    (terms, workspace.gradient().to_vec())
}

fn total(case: &Case, arena: &[f64], loss: &E2cLoss) -> f64 {
    run(case, arena, loss).0.total(loss)
}

#[test]
fn the_gradient_of_e2cs_loss_and_of_each_of_its_terms_equals_finite_differences() {
    let none = E2cLoss { anchor_scale: 0.8, ..E2cLoss::default() };
    for case in locally_linear_cases() {
        for (loss, each) in [
            (EVERY_TERM, case.each),
            (E2cLoss { encode_decode: 1.0, ..none }, 3),
            (E2cLoss { prediction: 1.0, ..none }, 3),
            (E2cLoss { prior: 1.0, ..none }, 3),
            (E2cLoss { transition_kl: 1.0, ..none }, 3),
            (E2cLoss { anchor: 1.0, ..none }, 3),
        ] {
            let gradient = run(&case, &case.model.arena, &loss).1;
            assert!(gradient.iter().any(|&g| g != 0.0));
            for (layer, which) in some_of(&case.model.nets.layout.layers, each) {
                let what = format!("{loss:?}: {layer}");
                check(&what, &case.model.arena, &gradient, &which, |arena| total(&case, arena, &loss));
                assert!(!layer.starts_with("backward.") || which.iter().all(|&i| gradient[i] == 0.0), "{layer}");
            }
        }
    }
}

/// A dense matrix by rows.
type Matrix = Vec<Vec<f64>>;

fn product(a: &Matrix, b: &Matrix) -> Matrix {
    let column = |j: usize| b.iter().map(move |row| row[j]);
    let of_row =
        |row: &Vec<f64>| (0..b[0].len()).map(|j| row.iter().zip(column(j)).map(|(a, b)| a * b).sum()).collect();
    a.iter().map(of_row).collect()
}

fn transposed(a: &Matrix) -> Matrix {
    (0..a[0].len()).map(|j| a.iter().map(|row| row[j]).collect()).collect()
}

/// By the first row's minors.
fn determinant(a: &Matrix) -> f64 {
    let minor = |j: usize| -> Matrix {
        let without = |row: &Vec<f64>| row.iter().enumerate().filter(|(k, _)| *k != j).map(|(_, &x)| x).collect();
        a[1..].iter().map(without).collect()
    };
    match a.len() {
        1 => a[0][0],
        _ => (0..a.len()).map(|j| if j % 2 == 0 { 1.0 } else { -1.0 } * a[0][j] * determinant(&minor(j))).sum(),
    }
}

fn diagonal(entries: impl Iterator<Item = f64>) -> Matrix {
    let entries: Vec<f64> = entries.collect();
    (0..entries.len()).map(|i| (0..entries.len()).map(|j| if i == j { entries[i] } else { 0.0 }).collect()).collect()
}

fn column(entries: &[f64]) -> Matrix {
    entries.iter().map(|&x| vec![x]).collect()
}

/// A, B and o at z, from the network's output: v, r, B by rows, o.
fn transition(model: &LceModel<f64>, z: &[f64]) -> (Matrix, Matrix, Vec<f64>) {
    let (n, a, net) = (model.sizes.latent, model.sizes.action, model.nets.dynamics.net());
    let mut pass = Pass::new(net, 1, 1);
    net.forward(&model.arena, z, &mut pass.view(1));
    let (v, r, rest) = (&pass.output()[..n], &pass.output()[n..2 * n], &pass.output()[2 * n..]);
    let matrix_a = (0..n).map(|i| (0..n).map(|j| f64::from(i == j) + v[i] * r[j]).collect()).collect();
    let matrix_b = (0..n).map(|i| rest[i * a..(i + 1) * a].to_vec()).collect();
    (matrix_a, matrix_b, rest[n * a..].to_vec())
}

fn moved((a, b, o): &(Matrix, Matrix, Vec<f64>), z: &[f64], u: &[f64]) -> Vec<f64> {
    let (az, bu) = (product(a, &column(z)), product(b, &column(u)));
    (0..o.len()).map(|k| az[k][0] + bu[k][0] + o[k]).collect()
}

/// Dense matrices, determinants by minors, one sample at a time.
#[test]
fn the_terms_of_e2c_are_those_of_dense_matrices() {
    for case in locally_linear_cases().into_iter().take(2) {
        let model = &case.model;
        let (n, a) = (model.sizes.latent, model.sizes.action);
        let gaussians = model.encode(&case.pictures);
        let gaussian = |image: u32| gaussians[image as usize * 2 * n..][..2 * n].split_at(n);
        let variances = |log_sigmas: &[f64]| log_sigmas.iter().map(|l| (2.0 * l).exp()).collect::<Vec<_>>();
        let mut decoded = vec![0.0; case.pictures.len() * n];
        let mut sums = E2cTerms::<f64>::default();
        for i in 0..SAMPLES {
            let (x, x_next, u) = (case.pairs[2 * i], case.pairs[2 * i + 1], &case.actions[i * a..][..a]);
            let ((mu, log_sigma), (mu_next, log_sigma_next)) = (gaussian(x), gaussian(x_next));
            let z: Vec<f64> = (0..n).map(|k| mu[k] + log_sigma[k].exp() * case.noise[i * n + k]).collect();
            let transition = transition(model, &z);
            let z_next = moved(&transition, &z, u);
            decoded[x as usize * n..][..n].copy_from_slice(&z);
            decoded[x_next as usize * n..][..n].copy_from_slice(&z_next);
            let (s, s_next) = (variances(log_sigma), variances(log_sigma_next));
            let covariance = {
                let matrix_a = &transition.0;
                product(&product(matrix_a, &diagonal(s.iter().copied())), &transposed(matrix_a))
            };
            let mean = moved(&transition, mu, u);
            let trace: f64 = (0..n).map(|k| covariance[k][k] / s_next[k]).sum();
            let distance: f64 = (0..n).map(|k| (mean[k] - mu_next[k]).powi(2) / s_next[k]).sum();
            let ratio = s_next.iter().product::<f64>() / determinant(&covariance);
            sums.transition_kl += 0.5 * (trace + distance - n as f64 + ratio.ln());
            sums.prior += (0..n).map(|k| 0.5 * (s[k] + mu[k] * mu[k] - 1.0 - s[k].ln())).sum::<f64>();
            let pushed = |k: usize| mu_next[k] - mu[k] - 0.8 * u.get(k).copied().unwrap_or(0.0);
            sums.anchor += (0..n).map(|k| pushed(k).powi(2)).sum::<f64>();
        }
        let nats = model.reconstruction_nll(&case.pictures, &decoded);
        for pair in case.pairs.chunks_exact(2) {
            sums.encode_decode += nats[pair[0] as usize];
            sums.prediction += nats[pair[1] as usize];
        }
        let (terms, _) = run(&case, &model.arena, &EVERY_TERM);
        for ((name, term), (_, sum)) in terms.named().into_iter().zip(sums.named()) {
            let expected = sum / SAMPLES as f64;
            assert!((term - expected).abs() < 1e-9 * expected.abs().max(1.0), "{name}: {term}, not {expected}");
        }
    }
}

#[test]
fn a_locally_linear_f_predicts_a_z_plus_b_u_plus_o() {
    for case in locally_linear_cases() {
        let (n, a) = (case.model.sizes.latent, case.model.sizes.action);
        let (z, u) = (&case.noise[..n], &case.actions[..a]);
        let expected = moved(&transition(&case.model, z), z, u);
        let predicted = case.model.predict_mean(z, u);
        assert!(predicted.iter().zip(expected).all(|(p, e)| (p - e).abs() < 1e-12));
    }
}
