//! Networks by hand on faer matrices: layers, heads, Adam, kernels.

pub mod adam;
pub(crate) mod columns;
pub mod conv;
pub mod heads;
mod lanes;
pub mod mat;
pub mod math;
pub mod mlp;
pub mod noise;
pub mod pictures;
mod real;
mod threads;

pub use real::Real;
pub use threads::{Threads, join};

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
