//! Test support: runs kernels on every instruction set of this machine.

use std::{cell::Cell, fmt::Debug};

use pulp::{
    Arch,
    x86::{V3, V4},
};

thread_local! {
    static FORCED: Cell<Option<Arch>> = const { Cell::new(None) };
}

/// The instruction set that kernels on this thread must use, if a test chose one.
pub(super) fn forced() -> Option<Arch> {
    FORCED.get()
}

/// Runs `work` on every instruction set of this machine and asserts equal results.
pub(crate) fn on_every_instruction_set<R: PartialEq + Debug>(work: impl Fn() -> R) {
    let wide = [V4::try_new().map(Arch::V4), V3::try_new().map(Arch::V3)];
    let plain = work_on(Arch::Scalar, &work);
    for arch in wide.into_iter().flatten() {
        assert!(work_on(arch, &work) == plain, "{arch:?} gives other bits than scalar arithmetic");
    }
}

fn work_on<R>(arch: Arch, work: impl Fn() -> R) -> R {
    FORCED.set(Some(arch));
    let result = work();
    FORCED.set(None);
    result
}
