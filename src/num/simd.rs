//! Vectors of numbers, as wide as the machine has them.
//!
//! A kernel written over [`Lanes`] computes every entry by the same chain of operations whatever the width, so its bits
//! do not depend on the instruction set.

use pulp::Simd;

/// Numbers that fit a vector register.
pub trait Lanes: Copy {
    /// A register of them.
    type V<S: Simd>: Copy;
    /// How many fit.
    fn count<S: Simd>() -> usize {
        size_of::<Self::V<S>>() / size_of::<Self>()
    }
    /// A slice as registers; what does not fill the last one is left out.
    fn cut<S: Simd>(x: &[Self]) -> &[Self::V<S>];
    /// The same, to change.
    fn cut_mut<S: Simd>(x: &mut [Self]) -> &mut [Self::V<S>];
    /// The same number in every lane.
    fn splat<S: Simd>(simd: S, x: Self) -> Self::V<S>;
    /// a b + c, rounded once.
    fn mul_add<S: Simd>(simd: S, a: Self::V<S>, b: Self::V<S>, c: Self::V<S>) -> Self::V<S>;
    /// The larger of each pair.
    fn max<S: Simd>(simd: S, a: Self::V<S>, b: Self::V<S>) -> Self::V<S>;
    /// The sum of each pair.
    fn add<S: Simd>(simd: S, a: Self::V<S>, b: Self::V<S>) -> Self::V<S>;
}

macro_rules! lanes {
    ($ty:ty, $v:ident, $cut:ident, $cut_mut:ident, $splat:ident, $mul_add:ident, $max:ident, $add:ident) => {
        impl Lanes for $ty {
            type V<S: Simd> = S::$v;
            #[inline(always)]
            fn cut<S: Simd>(x: &[Self]) -> &[S::$v] {
                S::$cut(x).0
            }
            #[inline(always)]
            fn cut_mut<S: Simd>(x: &mut [Self]) -> &mut [S::$v] {
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
            #[inline(always)]
            fn add<S: Simd>(simd: S, a: S::$v, b: S::$v) -> S::$v {
                simd.$add(a, b)
            }
        }
    };
}
lanes!(f32, f32s, as_simd_f32s, as_mut_simd_f32s, splat_f32s, mul_add_f32s, max_f32s, add_f32s);
lanes!(f64, f64s, as_simd_f64s, as_mut_simd_f64s, splat_f64s, mul_add_f64s, max_f64s, add_f64s);

/// Runs a loop with the widest vectors the machine has. Element-wise loops give the same bits on each of them.
#[inline(always)]
pub fn vectorize<R>(body: impl FnOnce() -> R) -> R {
    arch().dispatch(body)
}

/// Whether products are chains of fused multiply-adds on this machine, as on all that give the same results.
pub(crate) fn has_fused_vectors() -> bool {
    !matches!(pulp::Arch::new(), pulp::Arch::Scalar)
}

/// The widest instruction set of this machine.
pub(crate) fn arch() -> pulp::Arch {
    #[cfg(test)]
    if let Some(arch) = tests::FORCED.get() {
        return arch;
    }
    pulp::Arch::new()
}

#[cfg(test)]
pub(crate) mod tests {
    use std::{cell::Cell, fmt::Debug};

    use pulp::{
        Arch,
        x86::{V3, V4},
    };

    thread_local! {
        /// What this thread takes for the machine's instruction set.
        pub(super) static FORCED: Cell<Option<Arch>> = const { Cell::new(None) };
    }

    /// Does the same work with every instruction set of this machine, and compares.
    pub(crate) fn on_every_instruction_set<R: PartialEq + Debug>(work: impl Fn() -> R) {
        let wide = [V4::try_new().map(Arch::V4), V3::try_new().map(Arch::V3)];
        let plain = work_on(Arch::Scalar, &work);
        for arch in wide.into_iter().flatten() {
            assert!(work_on(arch, &work) == plain, "{arch:?} gives other bits");
        }
    }

    fn work_on<R>(arch: Arch, work: impl Fn() -> R) -> R {
        FORCED.set(Some(arch));
        let result = work();
        FORCED.set(None);
        result
    }
}
