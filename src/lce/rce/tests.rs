use rand::SeedableRng as _;

use super::*;
use crate::{
    lce::{
        BackwardSizes, ImageNetworks, LceModel, PassiveDynamics, Sizes,
        dynamics::{DynamicsPass, Transition},
        transition_batch::TransitionBatch,
    },
    nn::binary_images::BinaryImages,
    num::{rng::Rng, sampling},
};

/// One coordinate, one action and six pixels: small enough for integrals on a grid.
fn tiny() -> (LceModel<f64>, BinaryImages) {
    let sizes = Sizes {
        shades: None,
        pixels: 6,
        latent: 1,
        action: 1,
        images: ImageNetworks::Dense,
        jacobian_heads: false,
        locally_linear: true,
        passive_dynamics: PassiveDynamics::None,
        encoder: [5, 5],
        decoder: [5, 5],
        dynamics: [5, 5],
        backward: BackwardSizes { z: 2, u: 2, x: 3, joint: 5 },
    };
    let mut rng = Rng::seed_from_u64(11);
    let mut model = LceModel::<f64>::new(sizes, vec![0; 6], &mut rng);
    model.arena.iter_mut().for_each(|w| *w *= 2.0);
    let frames: Vec<u8> = (0..12).map(|_| u8::from(sampling::index(&mut rng, 2) == 0)).collect();
    let images = model.pictures(&frames);
    (model, images)
}

const U: f64 = 0.6;
/// Half the width of a grid in standard deviations, and its points. The grid holds wider Gaussians than its own, too. The
/// trapezoidal rule is exact for Gaussians, and nearly so for networks with kinks.
const WIDE: f64 = 20.0;
const POINTS: usize = 641;

/// Standard normal numbers and their weights.
fn grid() -> Vec<(f64, f64)> {
    let step = 2.0 * WIDE / (POINTS - 1) as f64;
    let at = |i: usize| -WIDE + i as f64 * step;
    let weight = |e: f64| step * (-0.5 * e * e).exp() / (2.0 * std::f64::consts::PI).sqrt();
    (0..POINTS).map(|i| (at(i), weight(at(i)))).collect()
}

/// A(z̄), B(z̄) and o(z̄) of the tiny model.
fn transition(model: &LceModel<f64>, point: f64) -> [f64; 3] {
    let mut pass = DynamicsPass::new(&model.nets.dynamics, 1, 1);
    let mut columns = pass.view(1);
    model.nets.dynamics.forward(&model.arena, &[point, U], &mut columns);
    let Transition { v, r, b, o } = model.nets.dynamics.transition(&columns).expect("a transition");
    [1.0 + v[0] * r[0], b[0], o[0]]
}

/// D(x'|z').
fn likelihood(model: &LceModel<f64>, images: &BinaryImages, next: f64) -> f64 {
    (-model.reconstruction_nll(images, &[next; 2])[1]).exp()
}

/// p(x'|x, u), by integration over z and z̄ on a grid.
fn marginal(model: &LceModel<f64>, images: &BinaryImages) -> f64 {
    let codes = model.encode(images);
    let (mu, sigma) = (codes[0], codes[1].exp());
    let inner = |(e, weight): (f64, f64)| {
        let [a, b, o] = transition(model, mu + sigma * e);
        let of = |e: f64| likelihood(model, images, a * (mu + sigma * e) + b * U + o);
        weight * grid().into_iter().map(|(e, weight)| weight * of(e)).sum::<f64>()
    };
    grid().into_iter().map(inner).sum()
}

/// The terms of a sample for one pair of noises, with its weight.
struct Case {
    weight: f64,
    terms: RceTerms,
    /// ln p(z̄|x) - ln q(z̄) - ln q(z').
    log_ratio: f64,
}

/// Every pair of noises on a coarser grid.
fn cases(model: &LceModel<f64>, images: &BinaryImages) -> Vec<Case> {
    let every_second: Vec<_> = grid().into_iter().step_by(2).map(|(e, weight)| (e, 2.0 * weight)).collect();
    let pairs: Vec<_> = every_second.iter().flat_map(|&a| every_second.iter().map(move |&b| (a, b))).collect();
    let codes = model.encode(images);
    let mut workspace = RceWorkspace::new(model, pairs.len());
    let noise: Vec<f64> = pairs.iter().flat_map(|((a, _), (b, _))| [*a, *b]).collect();
    let (x, images_of_pairs) = (vec![0; pairs.len()], [0, 1].repeat(pairs.len()));
    let actions = vec![U; pairs.len()];
    let batch = TransitionBatch { images, pairs: &images_of_pairs, x: &x, actions: &actions, noise: &noise };
    workspace.step(1, model, &RceLoss { reconstruction: 1.0, consistency: 1.0, ..RceLoss::default() }, &batch);
    let RceWorkspace { mut backward, terms, .. } = workspace;
    let mut backward = backward.view(pairs.len());
    let unit = |e: f64| -0.5 * e * e - 0.5 * (2.0 * std::f64::consts::PI).ln();
    let case = |i: usize| {
        let ((a, of_a), (b, of_b)) = pairs[i];
        let gaussian = backward.gaussian(i);
        let (mean, log_sigma) = (gaussian[0], gaussian[1]);
        let point = mean + log_sigma.exp() * b;
        let prior = unit((point - codes[0]) / codes[1].exp()) - codes[1];
        let log_ratio = prior - (unit(b) - log_sigma) - (unit(a) - codes[3]);
        Case { weight: of_a * of_b, terms: terms[i], log_ratio }
    };
    (0..pairs.len()).map(case).collect()
}

/// Jensen's inequality turns E_q[w] = p(x'|x, u) into the bound E_q[ln w]. The first is an equality, so it tests every part
/// of w; the second says that the terms add up to E_q[ln w].
#[test]
fn the_terms_of_rce_are_a_bound_of_the_numerical_marginal_likelihood() {
    let (model, images) = tiny();
    let log_marginal = marginal(&model, &images).ln();
    let cases = cases(&model, &images);
    let mean = |f: &dyn Fn(&Case) -> f64| cases.iter().map(|case| case.weight * f(case)).sum::<f64>();
    assert!((mean(&|_| 1.0) - 1.0).abs() < 1e-9);
    let log_w = |case: &Case| -case.terms.reconstruction + case.terms.log_density + case.log_ratio;
    let estimated = mean(&|case| log_w(case).exp()).ln();
    assert!((estimated - log_marginal).abs() < 5e-4, "E_q[w] is e^{estimated}, the marginal is e^{log_marginal}");
    let bound = -mean(&|case| case.terms.reconstruction + case.terms.consistency());
    let jensen = mean(&log_w);
    assert!((bound - jensen).abs() < 1e-6, "the terms give {bound}, E_q[ln w] is {jensen}");
    assert!(bound < log_marginal - 1e-3, "{bound} is no bound of {log_marginal}");
}
