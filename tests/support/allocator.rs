//! An allocator that counts the requests for memory of one piece of work on its thread.
#![allow(unsafe_code, reason = "a global allocator is unsafe by contract")]

use std::{
    alloc::{GlobalAlloc, Layout, System},
    backtrace::Backtrace,
    cell::Cell,
};

struct Counting;

/// What one piece of work asked the allocator for.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Asked {
    pub times: usize,
    pub bytes: usize,
    /// Bytes of the largest request.
    pub largest: usize,
}

thread_local! {
    static COUNTS: Cell<bool> = const { Cell::new(false) };
    static ASKED: Cell<Asked> = const { Cell::new(Asked { times: 0, bytes: 0, largest: 0 }) };
    static SHOWN: Cell<usize> = const { Cell::new(0) };
}

fn note(bytes: usize) {
    if !COUNTS.get() {
        return;
    }
    let Asked { times, bytes: before, largest } = ASKED.get();
    ASKED.set(Asked { times: times + 1, bytes: before.saturating_add(bytes), largest: largest.max(bytes) });
    if SHOWN.get() > 0 {
        COUNTS.set(false);
        SHOWN.set(SHOWN.get() - 1);
        eprintln!("{bytes} bytes:\n{}", Backtrace::force_capture());
        COUNTS.set(true);
    }
}

// SAFETY: every call goes to the system's allocator as it came; counting touches only plain cells of the thread.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        note(layout.size());
        // SAFETY: the caller's layout, unchanged.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        note(layout.size());
        // SAFETY: the caller's layout, unchanged.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, memory: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        note(size);
        // SAFETY: the caller's memory and layout, unchanged.
        unsafe { System.realloc(memory, layout, size) }
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        // SAFETY: the caller's memory and layout, unchanged.
        unsafe { System.dealloc(memory, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// What `work` asks for on this thread.
pub fn asked(work: impl FnOnce()) -> Asked {
    ASKED.set(Asked::default());
    SHOWN.set(if std::env::var_os("CARL_SHOW_ALLOCATIONS").is_some() { 3 } else { 0 });
    COUNTS.set(true);
    work();
    COUNTS.set(false);
    ASKED.get()
}
