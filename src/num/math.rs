//! exp, ln, log1p and tanh in `f32` with the same bits on every machine: `mul_add` polynomials in a fixed order, without
//! branches.
//!
//! Functions of libm differ between versions and processors, so nothing that reaches a result may call them.

/// e^x, within 2 ulp. Arguments are clamped to -87..=88.
#[inline(always)]
pub fn exp(x: f32) -> f32 {
    const LOG2_E: f32 = std::f32::consts::LOG2_E;
    const LN2_HIGH: f32 = 0.693_359_4;
    const LN2_LOW: f32 = -2.121_944_4e-4;
    // Adding and subtracting 1.5 * 2^23 rounds to the nearest integer.
    const ROUND: f32 = 12_582_912.0;
    let x = x.clamp(-87.0, 88.0);
    let rounded = x.mul_add(LOG2_E, ROUND);
    let n = rounded - ROUND;
    let r = n.mul_add(-LN2_LOW, n.mul_add(-LN2_HIGH, x));
    let p = 1.987_569_1e-4_f32;
    let p = p.mul_add(r, 1.398_2e-3);
    let p = p.mul_add(r, 8.333_452e-3);
    let p = p.mul_add(r, 4.166_579_6e-2);
    let p = p.mul_add(r, 1.666_666_5e-1);
    let p = p.mul_add(r, 0.5);
    let y = p.mul_add(r * r, r) + 1.0;
    // The lowest bits of `rounded` are the bits of n.
    y * f32::from_bits((rounded.to_bits() << 23).wrapping_add(127 << 23))
}

/// The natural logarithm of a positive normal number, within 2 ulp.
#[inline(always)]
pub fn ln(x: f32) -> f32 {
    const SQRT_HALF_BITS: u32 = 0x3f35_04f3;
    let bits = x.to_bits().wrapping_sub(SQRT_HALF_BITS);
    let exponent = (bits as i32) >> 23;
    let m = f32::from_bits((bits & 0x007f_ffff) + SQRT_HALF_BITS) - 1.0;
    let n = exponent as f32;
    let p = 7.037_683_6e-2_f32;
    let p = p.mul_add(m, -1.151_461e-1);
    let p = p.mul_add(m, 1.167_699_9e-1);
    let p = p.mul_add(m, -1.242_014_1e-1);
    let p = p.mul_add(m, 1.424_932_3e-1);
    let p = p.mul_add(m, -1.666_805_7e-1);
    let p = p.mul_add(m, 2.000_071_5e-1);
    let p = p.mul_add(m, -2.499_999_4e-1);
    let p = p.mul_add(m, 3.333_333e-1);
    let m2 = m * m;
    let y = (p * m).mul_add(m2, n * -2.121_944_4e-4);
    let y = m2.mul_add(-0.5, y);
    n.mul_add(0.693_359_4, m + y)
}

/// ln(1 + x) for x in 0..=1, within 3 ulp.
#[inline(always)]
pub fn ln_1p(x: f32) -> f32 {
    // Adds what rounding 1 + x lost (Goldberg 1991, theorem 4).
    let u = 1.0 + x;
    let lost = x - (u - 1.0);
    ln(u) + lost / u
}

/// The hyperbolic tangent, within 4 ulp.
#[inline(always)]
pub fn tanh(x: f32) -> f32 {
    let a = x.abs();
    let e = exp(-2.0 * a);
    let large = (1.0 - e) / (1.0 + e);
    let s = a * a;
    let p = -5.704_988_7e-3_f32;
    let p = p.mul_add(s, 2.063_909e-2);
    let p = p.mul_add(s, -5.373_971_6e-2);
    let p = p.mul_add(s, 1.333_144_2e-1);
    let p = p.mul_add(s, -3.333_328e-1);
    let small = (p * s).mul_add(a, a);
    (if a < 0.625 { small } else { large }).copysign(x)
}

#[cfg(test)]
mod tests {
    /// The largest error in units of the last place of the exact value, over every `step`-th float of low..high.
    fn worst_ulp(ours: fn(f32) -> f32, exact: fn(f64) -> f64, low: f32, high: f32) -> f64 {
        let count = 2_000_000;
        (0..=count).map(|i| low + (high - low) * (i as f32 / count as f32)).fold(0.0, |worst, x| {
            let want = exact(f64::from(x));
            let nearest = want as f32;
            let ulp = f64::from(nearest.abs().next_up()) - f64::from(nearest.abs());
            worst.max((f64::from(ours(x)) - want).abs() / ulp)
        })
    }

    #[test]
    fn functions_stay_within_their_bounds() {
        assert!(worst_ulp(super::exp, f64::exp, -86.0, 88.0) < 2.0);
        assert!(worst_ulp(super::ln, f64::ln, 1e-6, 4.0) < 2.0);
        assert!(worst_ulp(super::ln, f64::ln, 1.0, 1e6) < 2.0);
        assert!(worst_ulp(super::ln_1p, f64::ln_1p, 1e-6, 1.0) < 3.0);
        assert!(worst_ulp(super::tanh, f64::tanh, -9.0, 9.0) < 4.0);
    }

    #[test]
    fn values_at_the_edges_are_exact() {
        assert_eq!(super::exp(0.0), 1.0);
        assert_eq!(super::ln(1.0), 0.0);
        assert_eq!(super::ln_1p(0.0), 0.0);
        assert_eq!(super::tanh(0.0), 0.0);
        assert_eq!(super::tanh(40.0), 1.0);
        assert!(super::exp(-1000.0) > 0.0 && super::exp(1000.0).is_finite());
    }

    #[test]
    fn every_instruction_set_gives_the_same_bits() {
        let xs: Vec<f32> = (0..10_000).map(|i| (i as f32 - 5_000.0) * 0.0031).collect();
        let plain: Vec<u32> = xs.iter().map(|&x| (super::tanh(x) * super::exp(x)).to_bits()).collect();
        let mut wide = vec![0_u32; xs.len()];
        crate::num::simd::vectorize(|| {
            for (y, &x) in wide.iter_mut().zip(&xs) {
                *y = (super::tanh(x) * super::exp(x)).to_bits();
            }
        });
        assert_eq!(plain, wide);
    }
}
