//! Threads of a computation.

use std::sync::{
    Arc,
    atomic::{AtomicUsize, Ordering},
};

/// How many threads a computation may use at the moment. The scheduler may change this at any time, because no result
/// depends on it.
#[derive(Debug, Clone)]
pub struct Threads(Arc<AtomicUsize>);

impl Threads {
    /// `count` threads, at least one.
    pub fn new(count: usize) -> Self {
        Self(Arc::new(AtomicUsize::new(count.max(1))))
    }

    /// The number of threads at the moment.
    pub fn get(&self) -> usize {
        self.0.load(Ordering::Relaxed)
    }

    /// Changes the number of threads.
    pub fn set(&self, count: usize) {
        self.0.store(count.max(1), Ordering::Relaxed);
    }
}

/// Runs `a` and `b`, at the same time if `threads` is above 1, else one after the other.
pub fn join<A: Send, B: Send>(threads: usize, a: impl FnOnce() -> A + Send, b: impl FnOnce() -> B + Send) -> (A, B) {
    if threads > 1 { rayon::join(a, b) } else { (a(), b()) }
}
