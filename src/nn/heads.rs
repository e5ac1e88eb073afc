//! The distributions that networks put out: diagonal Gaussians and Bernoulli pixels.
//!
//! A Gaussian is one column: its means, then its log standard deviations. Functions with a `weight` also add `weight` times
//! the gradient of their value to the `d_…` arguments.

use super::binary_images::{BinaryImages, Likelihood};
use crate::num::{Real, simd::vectorize};

/// ln(2 pi) / 2.
pub(crate) const HALF_LN_TAU: f64 = 0.918_938_533_204_672_8;

/// The means and the log standard deviations of a Gaussian.
pub fn halves<T>(column: &[T]) -> (&[T], &[T]) {
    column.split_at(column.len() / 2)
}

/// Draws the reparameterised sample mu + sigma epsilon.
#[inline(always)]
pub fn sample<T: Real>(gaussian: &[T], epsilon: &[T], out: &mut [T]) {
    let (mu, log_sigma) = halves(gaussian);
    for (((out, &mu), &log_sigma), &epsilon) in out.iter_mut().zip(mu).zip(log_sigma).zip(epsilon) {
        *out = log_sigma.e_to().fma(epsilon, mu);
    }
}

/// Adds the gradient with respect to a reparameterised sample to that of its Gaussian.
#[inline(always)]
pub fn sample_backward<T: Real>(gaussian: &[T], epsilon: &[T], d_sample: &[T], d_gaussian: &mut [T]) {
    let n = epsilon.len();
    for i in 0..n {
        d_gaussian[i] += d_sample[i];
        d_gaussian[n + i] += d_sample[i] * epsilon[i] * gaussian[n + i].e_to();
    }
}

/// KL(q || p) of two Gaussians.
#[inline(always)]
pub fn kl<T: Real>(q: &[T], p: &[T], weight: T, d_q: &mut [T], d_p: &mut [T]) -> T {
    let n = q.len() / 2;
    let half = T::of(0.5);
    let mut sum = T::ZERO;
    for i in 0..n {
        let difference = q[i] - p[i];
        let inverse = (-(p[n + i] + p[n + i])).e_to();
        let ratio = (q[n + i] + q[n + i]).e_to() * inverse;
        let scaled = difference * inverse;
        sum += p[n + i] - q[n + i] + half * (ratio + difference * scaled) - half;
        d_q[i] += weight * scaled;
        d_p[i] -= weight * scaled;
        d_q[n + i] += weight * (ratio - T::ONE);
        d_p[n + i] += weight * (T::ONE - ratio - difference * scaled);
    }
    sum
}

/// KL(q || N(0, I)).
#[inline(always)]
pub fn kl_to_unit<T: Real>(q: &[T], weight: T, d_q: &mut [T]) -> T {
    let n = q.len() / 2;
    let half = T::of(0.5);
    let mut sum = T::ZERO;
    for i in 0..n {
        let variance = (q[n + i] + q[n + i]).e_to();
        sum += half * (variance + q[i] * q[i] - T::ONE) - q[n + i];
        d_q[i] += weight * q[i];
        d_q[n + i] += weight * (variance - T::ONE);
    }
    sum
}

/// The entropy of a Gaussian.
#[inline(always)]
pub fn entropy<T: Real>(q: &[T], weight: T, d_q: &mut [T]) -> T {
    let n = q.len() / 2;
    let mut sum = T::ZERO;
    for i in 0..n {
        sum += q[n + i] + T::of(HALF_LN_TAU + 0.5);
        d_q[n + i] += weight;
    }
    sum
}

/// ln N(z; mu, sigma²), with gradients for the point and for the Gaussian.
#[inline(always)]
pub fn log_density<T: Real>(z: &[T], gaussian: &[T], weight: T, d_z: &mut [T], d_gaussian: &mut [T]) -> T {
    let n = z.len();
    let mut sum = T::ZERO;
    for i in 0..n {
        let inverse = (-gaussian[n + i]).e_to();
        let unit = (z[i] - gaussian[i]) * inverse;
        sum -= T::of(0.5) * unit * unit + gaussian[n + i] + T::of(HALF_LN_TAU);
        let slope = weight * unit * inverse;
        d_z[i] -= slope;
        d_gaussian[i] += slope;
        d_gaussian[n + i] += weight * (unit * unit - T::ONE);
    }
    sum
}

/// -ln of the likelihood of an image, with one logit for each entry of the image. Sets `delta` to `weight` times its
/// gradient.
pub fn image<T: Real>(logits: &[T], images: &BinaryImages, image: u32, weight: T, delta: &mut [T]) -> T {
    match images.likelihood() {
        Likelihood::Bernoulli => bernoulli(logits, images, image, weight, delta),
        Likelihood::Gaussian(noise) => gaussian_pixels(logits, images, image, noise.sigma, weight, delta),
    }
}

/// -ln of the density of an image under independent Gaussian pixels with means sigmoid(logits). Pixels of a patch count
/// as if each had the mean of the patch. Sets `delta` to `weight` times its gradient,
/// area (m - x) m (1 - m) / sigma².
fn gaussian_pixels<T: Real>(
    logits: &[T],
    images: &BinaryImages,
    image: u32,
    sigma: f64,
    weight: T,
    delta: &mut [T],
) -> T {
    let area = images.predicted_area() as f64;
    delta.fill(T::ZERO);
    images.lit(image).for_each(|(entry, count)| delta[entry] += T::of(count / area));
    let (precision, constant) = (1.0 / (sigma * sigma), T::of(sigma).log() + T::of(HALF_LN_TAU));
    let (half_precision, steepness) = (T::of(0.5 * area * precision), weight * T::of(area * precision));
    let mut value = constant * T::of(area * logits.len() as f64);
    for (&logit, delta) in logits.iter().zip(delta) {
        let mean = T::ONE / (T::ONE + (-logit).e_to());
        let error = mean - *delta;
        value += half_precision * error * error;
        *delta = steepness * error * mean * (T::ONE - mean);
    }
    value
}

/// -ln of the probability of an image under independent Bernoulli pixels, with one logit for each entry of the image.
/// Sets `delta` to `weight` times its gradient, area sigmoid(logits) - lit.
fn bernoulli<T: Real>(logits: &[T], images: &BinaryImages, image: u32, weight: T, delta: &mut [T]) -> T {
    let area = T::of(images.predicted_area() as f64);
    let steepness = weight * area;
    // There are sixteen interleaved sums, added in order, so vectors of any width give the same bits. ln(1 + e^-|l|) is
    // summed as the logarithm of a product of up to 64 factors, each at most 2.
    let (mut positive, mut logarithms) = ([T::ZERO; 16], [T::ZERO; 16]);
    let (logits_16, logits_rest) = logits.as_chunks::<16>();
    let (delta_16, delta_rest) = delta.as_chunks_mut::<16>();
    vectorize(
        #[inline(always)]
        || {
            for (logits, delta) in logits_16.chunks(64).zip(delta_16.chunks_mut(64)) {
                let mut product = [T::ONE; 16];
                for (logits, delta) in logits.iter().zip(delta) {
                    for i in 0..16 {
                        let (factor, above) = sigmoid(logits[i], steepness, &mut delta[i]);
                        product[i] *= factor;
                        positive[i] += above;
                    }
                }
                for i in 0..16 {
                    logarithms[i] += product[i].log();
                }
            }
        },
    );
    for (i, (&l, delta)) in logits_rest.iter().zip(delta_rest).enumerate() {
        let (factor, above) = sigmoid(l, steepness, delta);
        logarithms[i] += factor.log();
        positive[i] += above;
    }
    let sum = |lanes: [T; 16]| lanes.into_iter().fold(T::ZERO, |sum, lane| sum + lane);
    let mut value = area * (sum(positive) + sum(logarithms));
    for (entry, count) in images.lit(image) {
        let count = T::of(count);
        delta[entry] -= weight * count;
        value -= logits[entry] * count;
    }
    value
}

/// Sets delta = weight sigmoid(l). Returns 1 + e^-|l| and max(l, 0): softplus(l) is the logarithm of the first plus the
/// second.
#[inline(always)]
fn sigmoid<T: Real>(l: T, weight: T, delta: &mut T) -> (T, T) {
    // Beyond this bound the gradients of pixels that are never lit would become subnormal.
    let steepest = T::of(50.0);
    let above = l.larger(T::ZERO);
    let e = (l - above - above).larger(-steepest).e_to();
    let factor = T::ONE + e;
    *delta = weight * (if l > T::ZERO { T::ONE } else { e }) / factor;
    (factor, above)
}
