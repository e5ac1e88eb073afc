//! Normal and uniform samples with the same bits on every machine.

use rand::RngExt as _;

use super::{Real, math, rng::Rng};

/// Fills `out` with samples of N(0, 1), drawn by Marsaglia's polar method.
pub fn fill_normal<T: Real>(rng: &mut Rng, out: &mut [T]) {
    let mut pairs = out.chunks_mut(2);
    for pair in &mut pairs {
        let (a, b) = normal_pair(rng);
        pair[0] = T::of(f64::from(a));
        if let Some(second) = pair.get_mut(1) {
            *second = T::of(f64::from(b));
        }
    }
}

fn normal_pair(rng: &mut Rng) -> (f32, f32) {
    loop {
        let (u, v) = (uniform(rng, -1.0, 1.0), uniform(rng, -1.0, 1.0));
        let s = u * u + v * v;
        if s > 0.0 && s < 1.0 {
            let scale = (-2.0 * math::ln(s) / s).sqrt();
            return (u * scale, v * scale);
        }
    }
}

/// A uniform sample from low..high.
pub fn uniform(rng: &mut Rng, low: f32, high: f32) -> f32 {
    let unit = (rng.random::<u32>() >> 8) as f32 * (1.0 / 16_777_216.0);
    low + (high - low) * unit
}

/// A uniform index below `count`.
pub fn index(rng: &mut Rng, count: usize) -> usize {
    ((u64::from(rng.random::<u32>()) * count as u64) >> 32) as usize
}

/// Shuffles `order` (Fisher-Yates).
pub fn shuffle(rng: &mut Rng, order: &mut [u32]) {
    for i in (1..order.len()).rev() {
        order.swap(i, index(rng, i + 1));
    }
}

/// The indices 0..count in random order.
pub fn shuffled(rng: &mut Rng, count: usize) -> Vec<u32> {
    let mut order: Vec<u32> = (0..count as u32).collect();
    shuffle(rng, &mut order);
    order
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng as _;

    #[test]
    fn normal_samples_have_mean_zero_and_variance_one() {
        let mut samples = vec![0.0_f64; 200_001];
        super::fill_normal(&mut crate::num::rng::Rng::seed_from_u64(1), &mut samples);
        let mean = samples.iter().sum::<f64>() / samples.len() as f64;
        let variance = samples.iter().map(|x| x * x).sum::<f64>() / samples.len() as f64;
        assert!(mean.abs() < 0.01 && (variance - 1.0).abs() < 0.02, "{mean} {variance}");
    }
}
