//! Gradients of convolutions' weights, summed over equal shares of a batch, in order, and then over the shares: no sum
//! depends on how many threads there were.

use std::ops::Range;

use super::Conv;
use crate::{
    nn::columns::{Block, BlockMut, Cut, over_samples},
    num::{Real, simd::vectorize},
};

/// ShardSums of a batch.
const SHARES: usize = 8;

/// What every thread has of its own, one for each.
#[derive(Debug)]
pub struct PerThread<'a, S>(pub(super) &'a mut [S]);

impl<S> Cut for PerThread<'_, S> {
    fn cut(self, _: usize) -> (Self, Self) {
        let (left, right) = self.0.split_at_mut(self.0.len() / 2);
        (Self(left), Self(right))
    }
}

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

/// For every share the sums of each layer: the core's weights, then its biases; the caller's own come last.
#[derive(Debug, Clone)]
pub struct ShardSums<T> {
    width: usize,
    sums: Block<T>,
}

impl<T: Real> ShardSums<T> {
    /// Room for the layers' sums, and for `more` of the caller's.
    pub(super) fn new(convs: &[Conv], more: usize) -> Self {
        let width = convs.iter().map(|conv| conv.forward.weights() + conv.forward.c_out).sum::<usize>() + more;
        Self { width, sums: Block::new(width, SHARES) }
    }

    /// Begins the sums anew: calls `add` for each share, with its images, its sums, and what the thread has of its own.
    pub(super) fn sum<S: Send>(
        &mut self,
        threads: usize,
        images: usize,
        per_thread: &mut [S],
        add: &(impl Fn(Range<usize>, &mut [T], &mut S) + Sync),
    ) {
        self.sums.data.fill(T::ZERO);
        let columns = Columns { sums: self.sums.view(SHARES), per_thread: PerThread(per_thread) };
        over_samples(threads, 0, SHARES, columns, &|first, count, mut c| {
            for share in 0..count {
                let [low, high] = [first + share, first + share + 1].map(|share| images * share / SHARES);
                add(low..high, c.sums.sample(share), &mut c.per_thread.0[0]);
            }
        });
    }

    /// Adds the shares up, sets the layers' gradients, and gives the caller's own sums.
    pub(super) fn unfold(&mut self, convs: &[Conv], gradient: &mut [T]) -> &[T] {
        let (total, others) = self.sums.data.split_at_mut(self.width);
        vectorize(
            #[inline(always)]
            || {
                for share in others.chunks_exact(self.width) {
                    for (total, &sum) in total.iter_mut().zip(share) {
                        *total += sum;
                    }
                }
            },
        );
        let mut sums = &*total;
        for conv in convs {
            let ([dw, db], after) = cut(conv, sums);
            conv.unfold(dw, db, gradient);
            sums = after;
        }
        sums
    }
}

/// A layer's sums, and those that follow.
fn cut<'a, T>(conv: &Conv, sums: &'a [T]) -> ([&'a [T]; 2], &'a [T]) {
    let (dw, after) = sums.split_at(conv.forward.weights());
    let (db, after) = after.split_at(conv.forward.c_out);
    ([dw, db], after)
}

/// The sums of one layer after the other: weights and biases; and the caller's own.
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
