//! The latent replay buffer B_latent of the paper's algorithm.

use crate::num::{rng::Rng, sampling};

/// Tuples that a new buffer reserves memory for, so that steps do not allocate. Memory that is never touched costs
/// nothing.
const RESERVED: usize = 1 << 20;

/// One tuple (z, a, z', z_g), read from its column.
#[derive(Debug, Clone, Copy)]
pub(super) struct Tuple<'a> {
    /// The code before the action.
    pub(super) z: &'a [f32],
    /// The action, in -1..1.
    pub(super) action: &'a [f32],
    /// The code after the action, sampled from F.
    pub(super) z_next: &'a [f32],
    /// The goal's code.
    pub(super) z_goal: &'a [f32],
}

impl<'a> Tuple<'a> {
    /// Length of a column.
    pub(super) fn width(latent: usize, action: usize) -> usize {
        3 * latent + action
    }

    /// Reads a column.
    #[inline(always)]
    pub(super) fn read(column: &'a [f32], latent: usize, action: usize) -> Self {
        let (z, rest) = column.split_at(latent);
        let (action, rest) = rest.split_at(action);
        let (z_next, z_goal) = rest.split_at(latent);
        Self { z, action, z_next, z_goal }
    }
}

/// Tuples (z, a, z', z_g), one column each. A full buffer overwrites its oldest tuple.
#[derive(Debug, Clone, PartialEq)]
pub struct LatentBuffer {
    /// The tuples, one after the other.
    pub columns: Vec<f32>,
    /// Numbers of a tuple.
    pub width: usize,
    /// How many tuples the buffer holds at most.
    pub capacity: usize,
    /// The column that the next tuple overwrites once the buffer is full.
    pub next: usize,
}

impl LatentBuffer {
    /// An empty buffer for `capacity` tuples of `width` numbers.
    pub(super) fn new(width: usize, capacity: usize) -> Self {
        Self { columns: Vec::with_capacity(capacity.min(RESERVED) * width), width, capacity, next: 0 }
    }

    /// Makes room for `count` tuples in all.
    ///
    /// # Errors
    /// The machine has not so much memory.
    pub fn reserve(&mut self, count: usize) -> Result<(), std::collections::TryReserveError> {
        let numbers = count.saturating_mul(self.width);
        self.columns.try_reserve_exact(numbers.saturating_sub(self.columns.len()))
    }

    /// Adds a tuple.
    pub(super) fn push(&mut self, column: &[f32]) {
        if self.columns.len() < self.capacity * self.width {
            self.columns.extend_from_slice(column);
        } else {
            self.columns[self.next * self.width..][..self.width].copy_from_slice(column);
        }
        self.next = (self.next + 1) % self.capacity;
    }

    /// A uniformly random tuple.
    pub(super) fn sample(&self, rng: &mut Rng) -> &[f32] {
        &self.columns[sampling::index(rng, self.columns.len() / self.width) * self.width..][..self.width]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_buffer_overwrites_its_oldest_tuples() {
        let mut buffer = LatentBuffer::new(2, 3);
        for i in 0..5 {
            buffer.push(&[i as f32, -(i as f32)]);
        }
        let mut firsts: Vec<f32> = buffer.columns.iter().step_by(2).copied().collect();
        firsts.sort_by(f32::total_cmp);
        assert_eq!(firsts, [2.0, 3.0, 4.0]);
    }
}
