//! Gradients of layers, heads and whole losses equal finite differences, in double precision.
//!
//! Layers and losses are checked at tiny sizes and on a random choice of parameters. A step of 1e-6 rarely crosses a
//! kink of a ReLU, and seeds are fixed, so the checks do not depend on luck.

use carl_pipe::{
    control::{Agent, distill},
    lce::{
        BackwardSizes, ImageNetworks, LceModel, PassiveDynamics, Sizes,
        objective::{Batch, Noise, Regularizer, Terms, Weights, Workspace},
        warm_up::{WarmUp, WarmUpBatch, WarmUpWorkspace},
    },
    nn::{
        adam::Adam,
        binary_images::{BinaryImages, PooledPatches},
        heads,
        mat::Accumulate,
        mlp::{Layout, Linear, Mlp, Pass},
    },
    num::{rng::Rng, sampling},
};
use rand::SeedableRng as _;

const H: f64 = 1e-6;

fn random(rng: &mut Rng, count: usize) -> Vec<f64> {
    (0..count).map(|_| f64::from(sampling::uniform(rng, -1.0, 1.0))).collect()
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Compares `gradient` with central differences of `value` in the entries `which`.
fn check(what: &str, at: &[f64], gradient: &[f64], which: &[usize], mut value: impl FnMut(&[f64]) -> f64) {
    assert_eq!(at.len(), gradient.len(), "{what}");
    let largest = gradient.iter().fold(1e-3_f64, |m, g| m.max(g.abs()));
    let mut moved = at.to_vec();
    for &i in which {
        moved[i] = at[i] + H;
        let above = value(&moved);
        moved[i] = at[i] - H;
        let below = value(&moved);
        moved[i] = at[i];
        let slope = (above - below) / (2.0 * H);
        let error = (slope - gradient[i]).abs() / largest;
        assert!(error < 1e-6, "{what}, entry {i}: the gradient says {}, differences say {slope}", gradient[i]);
    }
}

fn all(values: &[f64]) -> Vec<usize> {
    (0..values.len()).collect()
}

#[test]
fn a_layers_gradients_equal_finite_differences() {
    for (n_in, n_out, columns) in [(3, 4, 5), (1, 3, 2), (4, 1, 3), (5, 2, 1)] {
        let mut rng = Rng::seed_from_u64(1);
        let mut layout = Layout::default();
        let layer = layout.linear("layer", n_in, n_out);
        let (arena, x) = (layout.initialize::<f64>(&mut rng), random(&mut rng, n_in * columns));
        let weights = random(&mut rng, n_out * columns);
        let value = |arena: &[f64], x: &[f64]| {
            let mut y = vec![0.0; n_out * columns];
            layer.forward(arena, x, &mut y, false);
            dot(&weights, &y)
        };
        let (mut gradient, mut d_x) = (vec![7.0; layout.len], vec![7.0; x.len()]);
        layer.gradient(1, &mut gradient, Accumulate::Replace, &x, &weights);
        layer.backward(&arena, &weights, &mut d_x);
        check("weights", &arena, &gradient, &all(&arena), |arena| value(arena, &x));
        check("input", &x, &d_x, &all(&x), |x| value(&arena, x));
        let before = gradient.clone();
        layer.gradient(1, &mut gradient, Accumulate::Add, &x, &weights);
        assert!(gradient.iter().zip(&before).all(|(twice, once)| (twice - 2.0 * once).abs() < 1e-12));
    }
}

struct Net {
    net: Mlp<3>,
    arena: Vec<f64>,
    x: Vec<f64>,
    columns: usize,
}

fn net(rng: &mut Rng) -> Net {
    let (n_in, columns) = (3, 4);
    let mut layout = Layout::default();
    let net = layout.mlp("net", n_in, [6, 5, 2]);
    let arena = layout.initialize::<f64>(rng).iter().map(|w| 2.0 * w).collect();
    Net { net, arena, x: random(rng, n_in * columns), columns }
}

#[test]
fn a_networks_gradients_equal_finite_differences() {
    let mut rng = Rng::seed_from_u64(2);
    let Net { net, arena, x, columns } = net(&mut rng);
    let mut pass = Pass::new(&net, columns, 1);
    let mut pass = pass.view(columns);
    let weights = random(&mut rng, 2 * columns);
    let mut value = |arena: &[f64], x: &[f64]| {
        net.forward(arena, x, &mut pass);
        dot(&weights, pass.output())
    };
    let mut own = Pass::new(&net, columns, 1);
    let mut own = own.view(columns);
    net.forward(&arena, &x, &mut own);
    own.output_delta().copy_from_slice(&weights);
    let (mut gradient, mut d_x) = (vec![7.0; arena.len()], vec![7.0; x.len()]);
    net.backward(&arena, &mut own, Some(&mut d_x));
    net.gradient(1, &mut gradient, Accumulate::Replace, &x, &own);
    check("weights", &arena, &gradient, &all(&arena), |arena| value(arena, &x));
    check("input", &x, &d_x, &all(&x), |x| value(&arena, x));
}

#[test]
fn a_directional_derivative_and_its_gradient_equal_finite_differences() {
    let mut rng = Rng::seed_from_u64(3);
    let Net { net, arena, x, columns } = net(&mut rng);
    let direction = random(&mut rng, x.len());
    let weights = random(&mut rng, 2 * columns);
    let run = |arena: &[f64], x: &[f64]| {
        let (mut at, mut pass) = (Pass::new(&net, columns, 1), Pass::new(&net, columns, 1));
        net.forward(arena, x, &mut at.view(columns));
        net.tangent(arena, &at.view(columns), &direction, &mut pass.view(columns));
        (at, pass)
    };
    let (mut at, mut pass) = run(&arena, &x);
    let along = |step: f64| {
        let moved: Vec<f64> = x.iter().zip(&direction).map(|(x, d)| x + step * d).collect();
        run(&arena, &moved).0.output().to_vec()
    };
    for ((above, below), tangent) in along(H).iter().zip(along(-H)).zip(pass.output()) {
        assert!(((above - below) / (2.0 * H) - tangent).abs() < 1e-7);
    }
    let (at, mut pass) = (at.view(columns), pass.view(columns));
    pass.output_delta().copy_from_slice(&weights);
    net.tangent_backward(&arena, &at, &mut pass);
    let mut gradient = vec![0.0; arena.len()];
    net.add_tangent_gradient(&mut gradient, &direction, &pass);
    check("weights", &arena, &gradient, &all(&arena), |arena| dot(&weights, run(arena, &x).1.output()));
}

#[test]
fn gradients_of_gaussian_heads_equal_finite_differences() {
    let mut rng = Rng::seed_from_u64(4);
    let n = 3;
    let [q, p] = [(); 2].map(|()| random(&mut rng, 2 * n));
    let (z, epsilon, weights) = (random(&mut rng, n), random(&mut rng, n), random(&mut rng, n));
    let weight = 0.7;
    let zeros = || (vec![0.0; 2 * n], vec![0.0; 2 * n]);

    let kl = |q: &[f64], p: &[f64], (d_q, d_p): (&mut [f64], &mut [f64])| weight * heads::kl(q, p, weight, d_q, d_p);
    let value = |q: &[f64], p: &[f64]| {
        let (mut d_q, mut d_p) = zeros();
        kl(q, p, (&mut d_q, &mut d_p))
    };
    let (mut d_q, mut d_p) = zeros();
    kl(&q, &p, (&mut d_q, &mut d_p));
    check("q of KL", &q, &d_q, &all(&q), |q| value(q, &p));
    check("p of KL", &p, &d_p, &all(&p), |p| value(&q, p));

    let (mut d, _) = zeros();
    heads::kl_to_unit(&q, weight, &mut d);
    check("KL to N(0, I)", &q, &d, &all(&q), |q| weight * heads::kl_to_unit(q, 0.0, &mut zeros().0));
    assert!((heads::kl_to_unit(&q, 0.0, &mut zeros().0) - value(&q, &[0.0; 6]) / weight).abs() < 1e-12);

    let (mut d, _) = zeros();
    heads::entropy(&q, weight, &mut d);
    check("entropy", &q, &d, &all(&q), |q| weight * heads::entropy(q, 0.0, &mut zeros().0));

    let (mut d, mut d_z) = (vec![0.0; 2 * n], vec![0.0; n]);
    heads::log_density(&z, &q, weight, &mut d_z, &mut d);
    let density = |z: &[f64], q: &[f64]| weight * heads::log_density(z, q, 0.0, &mut [0.0; 3], &mut [0.0; 6]);
    check("Gaussian of a density", &q, &d, &all(&q), |q| density(&z, q));
    check("point of a density", &z, &d_z, &all(&z), |z| density(z, &q));

    let (mut d, _) = zeros();
    heads::sample_backward(&q, &epsilon, &weights, &mut d);
    check("sample", &q, &d, &all(&q), |q| {
        let mut out = vec![0.0; n];
        heads::sample(q, &epsilon, &mut out);
        dot(&weights, &out)
    });
}

/// The entropy of a Gaussian and its density agree: H = -E ln p, exact for a quadrature of three nodes.
#[test]
fn the_entropy_is_minus_the_mean_log_density() {
    let gaussian = [0.3, -0.7];
    let third: f64 = 3.0;
    let nodes = [(0.0, 2.0 / 3.0), (third.sqrt(), 1.0 / 6.0), (-third.sqrt(), 1.0 / 6.0)];
    let mean = nodes.map(|(epsilon, share)| {
        let mut z = [0.0];
        heads::sample(&gaussian, &[epsilon], &mut z);
        share * heads::log_density(&z, &gaussian, 0.0, &mut [0.0], &mut [0.0; 2])
    });
    assert!((heads::entropy(&gaussian, 0.0, &mut [0.0; 2]) + mean.iter().sum::<f64>()).abs() < 1e-12);
}

#[test]
fn the_gradient_of_bernoulli_pixels_equals_finite_differences() {
    let mut rng = Rng::seed_from_u64(5);
    let pixels = 37;
    let frames: Vec<u8> = (0..3 * pixels).map(|_| u8::from(sampling::index(&mut rng, 3) == 0)).collect();
    let mut pictures = BinaryImages::new(&frames[..pixels]);
    pictures.extend(&frames);
    let logits: Vec<f64> = random(&mut rng, pixels).iter().map(|l| 5.0 * l).collect();
    for picture in 0..3 {
        let mut delta = vec![7.0; pixels];
        let value = heads::bernoulli(&logits, &pictures, picture, 0.3, &mut delta);
        let plain = frames[picture as usize * pixels..][..pixels].iter().zip(&logits).map(|(&x, &l)| {
            let p = 1.0 / (1.0 + (-l).exp());
            if x != 0 { -p.ln() } else { -(1.0 - p).ln() }
        });
        assert!((value - plain.sum::<f64>()).abs() < 1e-10);
        check("logits", &logits, &delta, &all(&logits), |logits| {
            0.3 * heads::bernoulli(logits, &pictures, picture, 0.0, &mut vec![0.0; pixels])
        });
    }
}

/// A tiny model, its pictures and a batch.
struct Case {
    model: LceModel<f64>,
    pictures: BinaryImages,
    pairs: Vec<u32>,
    x: Vec<u32>,
    actions: Vec<f64>,
    noise: Vec<f64>,
    guidance: Vec<f64>,
    /// How many parameters of a layer are checked.
    each: usize,
}

const SAMPLES: usize = 5;

fn case(latent: usize, action: usize) -> Case {
    case_of(Sizes {
        jacobian_heads: false,
        passive_dynamics: PassiveDynamics::None,
        pixels: 23,
        latent,
        action,
        images: ImageNetworks::Dense,
        encoder: [7, 6],
        decoder: [5, 7],
        dynamics: [6, 5],
        backward: BackwardSizes { z: 3, u: 4, x: 5, joint: 6 },
    })
}

/// Two frames of 16 rows and 24 columns: 2x3 pixels where the picture is smallest, of 2 and of 3 channels.
fn convolutional_case() -> Case {
    case_of(Sizes {
        jacobian_heads: false,
        passive_dynamics: PassiveDynamics::None,
        pixels: 2 * 16 * 24,
        latent: 3,
        action: 2,
        images: ImageNetworks::Convolutional { frames: 2, rows: 16, columns: 24 },
        encoder: [2 * 6, 7],
        decoder: [6, 3 * 6],
        dynamics: [6, 5],
        backward: BackwardSizes { z: 3, u: 4, x: 5, joint: 6 },
    })
}

/// Six squares of 2x2 pixels.
fn squares_case() -> Case {
    let Case { model, .. } = case(2, 1);
    let images = ImageNetworks::Patches(PooledPatches { columns: 6, side: 2 });
    case_of(Sizes { pixels: 4 * 6, images, ..model.sizes })
}

/// With heads for F's slopes.
fn amortized_case() -> Case {
    let Case { model, .. } = case(2, 1);
    case_of(Sizes { jacobian_heads: true, ..model.sizes })
}

/// Three coordinates that move by themselves as well.
fn drifting_case() -> Case {
    let Case { model, .. } = case(3, 1);
    let mut case = case_of(Sizes { passive_dynamics: PassiveDynamics::Quadratic, ..model.sizes });
    // A drift begins at zero, where many slopes are zero too.
    let (name, layer) = case.model.nets.layout.layers.last().expect("layers");
    assert_eq!(name, "drift");
    let drift = &mut case.model.arena[layer.at..layer.at + layer.len()];
    assert_eq!(drift, [0.0; 3 * (1 + 3 + 6)]);
    drift.copy_from_slice(&random(&mut Rng::seed_from_u64(9), drift.len()));
    case.each = 30;
    case
}

fn case_of(sizes: Sizes) -> Case {
    let mut rng = Rng::seed_from_u64(6);
    let (pixels, latent, action) = (sizes.pixels, sizes.latent, sizes.action);
    let frames: Vec<u8> = (0..2 * SAMPLES * pixels).map(|_| u8::from(sampling::index(&mut rng, 4) == 0)).collect();
    let background = carl_pipe::lce::model::background(&frames, pixels);
    let mut model = LceModel::<f64>::new(sizes, background, &mut rng);
    // Wider than a fresh model, so that no part of the loss is flat.
    model.arena.iter_mut().for_each(|w| *w *= 1.8);
    let pictures = model.pictures(&frames);
    let pairs: Vec<u32> = (0..2 * SAMPLES as u32).rev().collect();
    let mut noise = vec![0.0; SAMPLES * Noise::<f64>::width(latent, action)];
    sampling::fill_normal(&mut rng, &mut noise);
    Case {
        x: pairs.iter().step_by(2).copied().collect(),
        pairs,
        actions: random(&mut rng, SAMPLES * action),
        noise,
        guidance: random(&mut rng, SAMPLES).iter().map(|w| 1.5 + w).collect(),
        each: if matches!(model.sizes.images, ImageNetworks::Convolutional { .. }) { 4 } else { 12 },
        model,
        pictures,
    }
}

/// Up to `each` parameters of every layer, weights and biases.
fn some_of(layers: &[(String, Linear)], each: usize) -> Vec<(String, Vec<usize>)> {
    let mut rng = Rng::seed_from_u64(7);
    let choose = |(name, layer): &(String, Linear)| {
        let mut which: Vec<u32> = (layer.at as u32..(layer.at + layer.len()) as u32).collect();
        sampling::shuffle(&mut rng, &mut which);
        let last = layer.at + layer.len() - 1;
        (name.clone(), which.iter().take(each).map(|&i| i as usize).chain([last]).collect())
    };
    layers.iter().map(choose).collect()
}

#[test]
fn the_gradient_of_the_whole_warm_up_equals_finite_differences() {
    let settings = WarmUp { sigma: 0.4, scale: 0.8, anchor: 3.0, huber_delta: 1.5, shrink: 0.05 };
    for case in [case(2, 2), case(3, 1), amortized_case(), drifting_case(), squares_case(), convolutional_case()] {
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
    for case in [case(2, 2), case(3, 1), amortized_case(), drifting_case(), squares_case(), convolutional_case()] {
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

/// A student and a teacher in single precision: differences along the gradient, over all parameters and by layer.
#[test]
fn the_gradient_of_distillation_equals_finite_differences() {
    let mut rng = Rng::seed_from_u64(8);
    let samples = 16;
    let new = |rng: &mut Rng| Agent::new(2, 2, None, 0.0, rng);
    let (teacher, mut student) = (new(&mut rng), new(&mut rng));
    let inputs: Vec<f32> = random(&mut rng, 4 * samples).iter().map(|&x| x as f32).collect();
    let targets = teacher.gaussians(&teacher.actor.arena, &inputs);
    let mut pass = Pass::new(&student.nets.actor.mlp, samples, 1);
    let mut gradient = vec![0.0; student.actor.arena.len()];
    let mut adam = Adam::new(gradient.len());
    let mut kl = |arena: &[f32], rate: f64, gradient: &mut [f32]| {
        student.actor.arena.copy_from_slice(arena);
        let kl = distill::step(&mut student, &mut adam, rate, &mut pass, gradient, (&inputs, &targets));
        (kl, student.actor.arena.clone())
    };
    let start = new(&mut rng).actor.arena;
    let layers = teacher.nets.actor.layout.layers.clone();
    let value = kl(&start, 0.0, &mut gradient).0;
    let whole = (0, start.len());
    for (at, len) in layers.iter().map(|(_, layer)| (layer.at, layer.len())).chain([whole]) {
        let part = &gradient[at..at + len];
        let norm = part.iter().map(|&g| f64::from(g).powi(2)).sum::<f64>().sqrt();
        let [above, below] = [2e-2, -2e-2].map(|step| {
            let mut moved = start.clone();
            for (p, &g) in moved[at..at + len].iter_mut().zip(part) {
                *p += (step * f64::from(g) / norm) as f32;
            }
            kl(&moved, 0.0, &mut vec![0.0; start.len()]).0
        });
        let slope = (above - below) / 4e-2;
        assert!((slope - norm).abs() < 0.02 * norm, "{at}: the gradient says {norm}, differences say {slope}");
    }
    let mut moving = start;
    for _ in 0..100 {
        moving = kl(&moving, 1e-3, &mut gradient).1;
    }
    let after = kl(&moving, 0.0, &mut gradient).0;
    assert!(after < 0.1 * value, "KL {value} -> {after}");
    assert!(kl(&teacher.actor.arena, 0.0, &mut gradient).0.abs() < 1e-6, "the teacher has nothing to learn");
    assert!(gradient.iter().all(|g| g.abs() < 1e-5));
}
