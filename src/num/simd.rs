//! Vector registers of any width.
//!
//! A kernel written with [`Lanes`] computes every number by the same chain of operations at any width, so its bits do not
//! depend on the instruction set.

use pulp::Simd;

/// A number type with vector registers.
pub trait Lanes: Copy {
    /// A register of these numbers.
    type V<S: Simd>: Copy;
    /// Numbers in a register.
    fn lanes<S: Simd>() -> usize {
        size_of::<Self::V<S>>() / size_of::<Self>()
    }
    /// A slice as registers. Numbers that do not fill a register at the end are left out.
    fn registers<S: Simd>(x: &[Self]) -> &[Self::V<S>];
    /// A mutable slice as registers, like [`Lanes::registers`].
    fn registers_mut<S: Simd>(x: &mut [Self]) -> &mut [Self::V<S>];
    /// A register with the same number in every lane.
    fn splat<S: Simd>(simd: S, x: Self) -> Self::V<S>;
    /// a b + c, rounded once.
    fn mul_add<S: Simd>(simd: S, a: Self::V<S>, b: Self::V<S>, c: Self::V<S>) -> Self::V<S>;
    /// The larger of each pair.
    fn max<S: Simd>(simd: S, a: Self::V<S>, b: Self::V<S>) -> Self::V<S>;
}

macro_rules! lanes {
    ($ty:ty, $v:ident, $cut:ident, $cut_mut:ident, $splat:ident, $mul_add:ident, $max:ident) => {
        impl Lanes for $ty {
            type V<S: Simd> = S::$v;
            #[inline(always)]
            fn registers<S: Simd>(x: &[Self]) -> &[S::$v] {
                S::$cut(x).0
            }
            #[inline(always)]
            fn registers_mut<S: Simd>(x: &mut [Self]) -> &mut [S::$v] {
                S::$cut_mut(x).0
            }
            #[inline(always)]
            fn splat<S: Simd>(simd: S, x: Self) -> S::$v {
                simd.$splat(x)
            }
            #[inline(always)]
            fn mul_add<S: Simd>(simd: S, a: S::$v, b: S::$v, c: S::$v) -> S::$v {
                simd.$mul_add(a, b, c)
            }
            #[inline(always)]
            fn max<S: Simd>(simd: S, a: S::$v, b: S::$v) -> S::$v {
                simd.$max(a, b)
            }
        }
    };
}
lanes!(f32, f32s, as_simd_f32s, as_mut_simd_f32s, splat_f32s, mul_add_f32s, max_f32s);
lanes!(f64, f64s, as_simd_f64s, as_mut_simd_f64s, splat_f64s, mul_add_f64s, max_f64s);

/// Runs `body` compiled for the widest vectors of this machine. Element-wise loops give the same bits at any width.
#[inline(always)]
pub fn vectorize<R>(body: impl FnOnce() -> R) -> R {
    arch().dispatch(body)
}

/// Whether this machine has vectors with fused multiply-add, which all results assume.
pub(crate) fn has_fused_vectors() -> bool {
    !matches!(pulp::Arch::new(), pulp::Arch::Scalar)
}

/// The widest instruction set of this machine; in tests, the one set by `on_every_instruction_set`.
pub(crate) fn arch() -> pulp::Arch {
    #[cfg(test)]
    if let Some(arch) = super::instruction_sets::forced() {
        return arch;
    }
    pulp::Arch::new()
}
