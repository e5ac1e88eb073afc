//! Gaussians, and Bernoulli and Gaussian pixels.

use carl_pipe::{
    nn::{
        binary_images::{BinaryImages, Deviation, Likelihood},
        heads,
    },
    num::{rng::Rng, sampling},
};
use rand::SeedableRng as _;

use super::{all, check, dot, random};

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
    let black_or_white: Vec<u8> = (0..3 * pixels).map(|_| u8::from(sampling::index(&mut rng, 3) == 0) * 255).collect();
    let mut pictures = BinaryImages::new(&black_or_white[..pixels]);
    pictures.extend(&black_or_white);
    let shades: Vec<u8> = (0..3 * pixels).map(|_| sampling::index(&mut rng, 256) as u8).collect();
    let mut shaded = BinaryImages::shaded(&shades[..pixels], Likelihood::Bernoulli);
    shaded.extend(&shades);
    for (frames, pictures) in [(black_or_white, pictures), (shades, shaded)] {
        holds(&frames, &pictures, |x, mean| -(x * mean.ln() + (1.0 - x) * (1.0 - mean).ln()));
    }
}

#[test]
fn the_gradient_of_gaussian_pixels_equals_finite_differences() {
    let mut rng = Rng::seed_from_u64(6);
    let shades: Vec<u8> = (0..3 * 37).map(|_| sampling::index(&mut rng, 256) as u8).collect();
    let sigma = 0.4_f64;
    let mut pictures = BinaryImages::shaded(&shades[..37], Likelihood::Gaussian(Deviation { sigma }));
    pictures.extend(&shades);
    let constant = sigma.ln() + (2.0 * std::f64::consts::PI).ln() / 2.0;
    holds(&shades, &pictures, |x, mean| ((x - mean) / sigma).powi(2) / 2.0 + constant);
}

/// Compares the value for three pictures with the sum of `nats` over pixels, and the gradient with differences.
fn holds(frames: &[u8], pictures: &BinaryImages, nats: impl Fn(f64, f64) -> f64) {
    let pixels = frames.len() / 3;
    let logits: Vec<f64> = random(&mut Rng::seed_from_u64(7), pixels).iter().map(|l| 5.0 * l).collect();
    for (picture, frame) in (0..3).zip(frames.chunks(pixels)) {
        let mut delta = vec![7.0; pixels];
        let value = heads::image(&logits, pictures, picture, 0.3, &mut delta);
        let plain = frame.iter().zip(&logits).map(|(&x, &l)| nats(f64::from(x) / 255.0, 1.0 / (1.0 + (-l).exp())));
        assert!((value - plain.sum::<f64>()).abs() < 1e-10);
        check("logits", &logits, &delta, &all(&logits), |logits| {
            0.3 * heads::image(logits, pictures, picture, 0.0, &mut vec![0.0; pixels])
        });
    }
}
