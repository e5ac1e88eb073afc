//! Weight gradients of convolutions, summed within shards of the batch and then over the shards, both in order. So no
//! sum depends on the number of threads.

use std::ops::Range;

use super::Conv;
use crate::{
    nn::columns::{Block, BlockMut, Cut, over_samples},
    num::{Real, simd::vectorize},
};

/// Shards of a batch.
const SHARDS: usize = 8;

/// One set of buffers per thread.
#[derive(Debug)]
pub struct PerThread<'a, S>(pub(super) &'a mut [S]);

impl<S> Cut for PerThread<'_, S> {
    fn cut(self, _: usize) -> (Self, Self) {
        let (left, right) = self.0.split_at_mut(self.0.len() / 2);
        (Self(left), Self(right))
    }
}

/// What the threads cut up among them: the sums, by shard, and their buffers.
struct Columns<'a, T, S> {
    sums: BlockMut<'a, T>,
    per_thread: PerThread<'a, S>,
}

impl<T, S> Cut for Columns<'_, T, S> {
    fn cut(self, samples: usize) -> (Self, Self) {
        let ((sums, right), (per_thread, per_thread_right)) = (self.sums.cut(samples), self.per_thread.cut(samples));
        (Self { sums, per_thread }, Self { sums: right, per_thread: per_thread_right })
    }
}

/// For every shard, the sums of each layer: its core's weight gradients, then its bias gradients. The caller's own sums
/// follow.
#[derive(Debug, Clone)]
pub struct ShardSums<T> {
    width: usize,
    sums: Block<T>,
}

impl<T: Real> ShardSums<T> {
    /// Buffers for the sums of the layers `convs`, and for `more` sums of the caller's own.
    pub(super) fn new(convs: &[Conv], more: usize) -> Self {
        let width = convs.iter().map(|conv| conv.forward.weights() + conv.forward.c_out).sum::<usize>() + more;
        Self { width, sums: Block::new(width, SHARDS) }
    }

    /// Sets all sums to 0, then calls `add` for each shard with its images, its sums and the thread's buffers.
    pub(super) fn sum<S: Send>(
        &mut self,
        threads: usize,
        images: usize,
        per_thread: &mut [S],
        add: &(impl Fn(Range<usize>, &mut [T], &mut S) + Sync),
    ) {
        self.sums.data.fill(T::ZERO);
        let columns = Columns { sums: self.sums.view(SHARDS), per_thread: PerThread(per_thread) };
        over_samples(threads, 0, SHARDS, columns, &|first, count, mut c| {
            for shard in 0..count {
                let [low, high] = [first + shard, first + shard + 1].map(|shard| images * shard / SHARDS);
                add(low..high, c.sums.sample(shard), &mut c.per_thread.0[0]);
            }
        });
    }

    /// Sums over the shards, sets the gradients of the layers, and returns the caller's own sums.
    pub(super) fn unfold(&mut self, convs: &[Conv], gradient: &mut [T]) -> &[T] {
        let (total, others) = self.sums.data.split_at_mut(self.width);
        vectorize(
            #[inline(always)]
            || {
                for shard in others.chunks_exact(self.width) {
                    for (total, &sum) in total.iter_mut().zip(shard) {
                        *total += sum;
                    }
                }
            },
        );
        let mut sums = &*total;
        for conv in convs {
            let (dw, after) = sums.split_at(conv.forward.weights());
            let (db, after) = after.split_at(conv.forward.c_out);
            conv.unfold(dw, db, gradient);
            sums = after;
        }
        sums
    }
}

/// The sums of a shard by layer, weights and biases, and the caller's own.
pub(super) fn by_layer<'a, T, const L: usize>(
    convs: &[Conv; L],
    mut sums: &'a mut [T],
) -> ([[&'a mut [T]; 2]; L], &'a mut [T]) {
    let layers = convs.each_ref().map(|conv| {
        let (dw, after) = std::mem::take(&mut sums).split_at_mut(conv.forward.weights());
        let (db, after) = after.split_at_mut(conv.forward.c_out);
        sums = after;
        [dw, db]
    });
    (layers, sums)
}
