//! The number type of networks: `f32` in production, `f64` where finite differences and golden data check them.

use std::{
    fmt::Debug,
    iter::Sum,
    ops::{Add, AddAssign, Div, Mul, MulAssign, Neg, Sub, SubAssign},
};

use super::math;

/// A floating-point number.
///
/// The functions have names of their own, since `f32::exp` and its like are those of libm, which differ between machines.
pub trait Real:
    Copy
    + Debug
    + Default
    + PartialOrd
    + Send
    + Sync
    + Sum
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + SubAssign
    + MulAssign
    + faer::traits::RealField
    + super::simd::Lanes
    + 'static
{
    /// 0.
    const ZERO: Self;
    /// 1.
    const ONE: Self;

    /// The nearest number of this type.
    fn of(value: f64) -> Self;
    /// This number in double precision.
    fn f64(self) -> f64;
    /// e^x.
    fn e_to(self) -> Self;
    /// The natural logarithm.
    fn log(self) -> Self;
    /// ln(1 + x) for x in 0..=1.
    fn log_1p(self) -> Self;
    /// The hyperbolic tangent.
    fn tan_h(self) -> Self;
    /// The square root.
    fn root(self) -> Self;
    /// self * a + b, rounded once.
    fn fma(self, a: Self, b: Self) -> Self;

    /// The larger of two numbers.
    fn larger(self, other: Self) -> Self {
        if self > other { self } else { other }
    }
    /// The smaller of two numbers.
    fn smaller(self, other: Self) -> Self {
        if self < other { self } else { other }
    }
}

macro_rules! real {
    ($ty:ty, $exp:expr, $ln:expr, $ln_1p:expr, $tanh:expr) => {
        impl Real for $ty {
            const ZERO: Self = 0.0;
            const ONE: Self = 1.0;

            #[inline(always)]
            fn of(value: f64) -> Self {
                value as $ty
            }
            #[inline(always)]
            fn f64(self) -> f64 {
                self as f64
            }
            #[inline(always)]
            fn e_to(self) -> Self {
                $exp(self)
            }
            #[inline(always)]
            fn log(self) -> Self {
                $ln(self)
            }
            #[inline(always)]
            fn log_1p(self) -> Self {
                $ln_1p(self)
            }
            #[inline(always)]
            fn tan_h(self) -> Self {
                $tanh(self)
            }
            #[inline(always)]
            fn root(self) -> Self {
                self.sqrt()
            }
            #[inline(always)]
            fn fma(self, a: Self, b: Self) -> Self {
                self.mul_add(a, b)
            }
        }
    };
}
real!(f32, math::exp, math::ln, math::ln_1p, math::tanh);
real!(f64, f64::exp, f64::ln, f64::ln_1p, f64::tanh);
