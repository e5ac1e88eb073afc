//! The processor's peak: fused multiply-adds on registers and nothing else.

#![allow(clippy::disallowed_methods, reason = "a benchmark reads the clock")]

use std::{hint::black_box, time::Instant};

use pulp::{Arch, Simd, WithSimd};

/// Independent sums, enough to hide the latency of two units.
const SUMS: usize = 16;
const ROUNDS: usize = 1 << 20;

struct Spin;

impl WithSimd for Spin {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f64 {
        let (a, b) = (black_box(simd.splat_f32s(1.000_000_1)), black_box(simd.splat_f32s(1e-9)));
        let mut sums: [S::f32s; SUMS] = std::array::from_fn(|i| simd.splat_f32s(i as f32));
        let start = Instant::now();
        for _ in 0..ROUNDS {
            for sum in &mut sums {
                *sum = simd.mul_add_f32s(*sum, a, b);
            }
        }
        let seconds = start.elapsed().as_secs_f64();
        black_box(sums);
        (2 * SUMS * ROUNDS * S::F32_LANES) as f64 / seconds / 1e9
    }
}

/// GFLOP/s of one thread in single precision, the best of a few tries.
pub(crate) fn gflops() -> f64 {
    (0..8).map(|_| Arch::new().dispatch(Spin)).fold(0.0, f64::max)
}
