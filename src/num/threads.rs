//! A node's share of the cores.

use std::sync::{
    Arc,
    atomic::{AtomicUsize, Ordering},
};

/// How many threads a computation may use right now. The engine may change it at any time, since no result depends
/// on it.
#[derive(Debug, Clone)]
pub struct Threads(Arc<AtomicUsize>);

impl Threads {
    /// A share of `count` threads, at least one.
    pub fn new(count: usize) -> Self {
        Self(Arc::new(AtomicUsize::new(count.max(1))))
    }

    /// The share at this moment.
    pub fn get(&self) -> usize {
        self.0.load(Ordering::Relaxed)
    }

    /// Changes the share.
    pub fn set(&self, count: usize) {
        self.0.store(count.max(1), Ordering::Relaxed);
    }
}

/// Does both pieces of work: at once where `threads` allows, else one after the other.
pub fn join<A: Send, B: Send>(threads: usize, a: impl FnOnce() -> A + Send, b: impl FnOnce() -> B + Send) -> (A, B) {
    if threads > 1 { rayon::join(a, b) } else { (a(), b()) }
}
