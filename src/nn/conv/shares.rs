//! Gradients of convolutions' weights, summed over equal shares of a batch, in order, and then over the shares: no sum
//! depends on how many threads there were.

use super::Conv;
use crate::nn::{Real, columns::Block, vectorize};

/// Shares of a batch.
pub(super) const SHARES: usize = 8;

/// For every share the sums of each layer: the core's weights, then its biases; the caller's own come last.
#[derive(Debug, Clone)]
pub struct Shares<T> {
    width: usize,
    pub(super) sums: Block<T>,
}

impl<T: Real> Shares<T> {
    /// Room for the layers' sums, and for `more` of the caller's.
    pub(super) fn new(convs: &[Conv], more: usize) -> Self {
        let width = convs.iter().map(|conv| conv.forward.weights() + conv.forward.c_out).sum::<usize>() + more;
        Self { width, sums: Block::new(width, SHARES) }
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

/// The pictures of a share.
pub(super) fn pictures_of(share: usize, pictures: usize) -> std::ops::Range<usize> {
    pictures * share / SHARES..pictures * (share + 1) / SHARES
}
