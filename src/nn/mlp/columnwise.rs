//! Operations on all columns of a batch: biases, ReLU and its gradient, sums.

use crate::{
    nn::mat::Accumulate,
    num::{Real, simd::vectorize},
};

/// y = y + b for every column, followed by a ReLU if `relu` is set.
pub fn add_bias<T: Real>(y: &mut [T], b: &[T], relu: bool) {
    vectorize(
        #[inline(always)]
        || {
            for y in y.chunks_exact_mut(b.len()) {
                if relu {
                    for (y, &b) in y.iter_mut().zip(b) {
                        *y = (*y + b).larger(T::ZERO);
                    }
                } else {
                    for (y, &b) in y.iter_mut().zip(b) {
                        *y += b;
                    }
                }
            }
        },
    );
}

/// x = max(x, 0).
pub fn rectify<T: Real>(x: &mut [T]) {
    vectorize(
        #[inline(always)]
        || {
            for x in x {
                *x = x.larger(T::ZERO);
            }
        },
    );
}

/// Sets deltas to 0 where the ReLU's output is 0.
pub fn mask<T: Real>(delta: &mut [T], out: &[T]) {
    vectorize(
        #[inline(always)]
        || {
            for (delta, &out) in delta.iter_mut().zip(out) {
                *delta = if out > T::ZERO { *delta } else { T::ZERO };
            }
        },
    );
}

/// Sets or adds the sum over columns.
pub fn sum_columns<T: Real>(sum: &mut [T], accumulate: Accumulate, columns: &[T]) {
    if accumulate == Accumulate::Replace {
        sum.fill(T::ZERO);
    }
    vectorize(
        #[inline(always)]
        || {
            for column in columns.chunks_exact(sum.len()) {
                for (sum, &x) in sum.iter_mut().zip(column) {
                    *sum += x;
                }
            }
        },
    );
}
