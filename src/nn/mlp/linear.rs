//! One affine layer.

use super::{add_bias, sum_columns};
use crate::{
    nn::mat::{self, Accumulate},
    num::{Real, join},
};

/// Products with fewer multiply-adds run on one thread.
const WORTH_A_THREAD: usize = 1 << 22;

/// An affine layer y = W x + b, as its place in the arena: W \[n_out, n_in\] column-major, then b.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Linear {
    /// Width of the input.
    pub n_in: usize,
    /// Width of the output.
    pub n_out: usize,
    /// Initial weights are bounded by 1/sqrt(fan_in).
    pub fan_in: usize,
    /// Index of the first weight.
    pub at: usize,
}

impl Linear {
    /// Number of parameters.
    pub fn len(&self) -> usize {
        (self.n_in + 1) * self.n_out
    }

    /// Whether the layer has no parameters.
    pub fn is_empty(&self) -> bool {
        self.n_out == 0
    }

    /// The weights.
    pub fn w<'a, T>(&self, arena: &'a [T]) -> &'a [T] {
        &arena[self.at..self.at + self.n_in * self.n_out]
    }

    /// The biases.
    pub fn b<'a, T>(&self, arena: &'a [T]) -> &'a [T] {
        &arena[self.at + self.n_in * self.n_out..self.at + self.len()]
    }

    /// The weights and the biases, mutable.
    pub fn w_b_mut<'a, T>(&self, arena: &'a mut [T]) -> (&'a mut [T], &'a mut [T]) {
        arena[self.at..self.at + self.len()].split_at_mut(self.n_in * self.n_out)
    }

    /// Computes y = W x + b for every column, followed by a ReLU if `relu` is set.
    pub fn forward<T: Real>(&self, arena: &[T], x: &[T], y: &mut [T], relu: bool) {
        let columns = y.len() / self.n_out;
        mat::product(y, Accumulate::Replace, self.w(arena), x, (self.n_out, self.n_in, columns));
        add_bias(y, self.b(arena), relu);
    }

    /// Computes dx = Wᵀ dy for every column.
    pub fn backward<T: Real>(&self, arena: &[T], dy: &[T], dx: &mut [T]) {
        let columns = dy.len() / self.n_out;
        mat::product_transposed(dx, Accumulate::Replace, self.w(arena), dy, (self.n_out, self.n_in, columns));
    }

    /// Sets or adds dW = Σ dy xᵀ and db = Σ dy, summed over columns.
    pub fn gradient<T: Real>(&self, threads: usize, gradient: &mut [T], accumulate: Accumulate, x: &[T], dy: &[T]) {
        let (dw, db) = self.w_b_mut(gradient);
        self.weight_gradient(threads, dw, accumulate, x, dy, 0);
        sum_columns(db, accumulate, dy);
    }

    /// Sets or adds the columns of dW = Σ dy xᵀ from column `first` on.
    pub(super) fn weight_gradient<T: Real>(
        &self,
        threads: usize,
        dw: &mut [T],
        accumulate: Accumulate,
        x: &[T],
        dy: &[T],
        first: usize,
    ) {
        let columns = dw.len() / self.n_out;
        if threads > 1 && columns > 1 && columns * dy.len() > WORTH_A_THREAD {
            let (left, right) = dw.split_at_mut(columns / 2 * self.n_out);
            join(
                threads,
                || self.weight_gradient(threads / 2, left, accumulate, x, dy, first),
                || self.weight_gradient(threads - threads / 2, right, accumulate, x, dy, first + columns / 2),
            );
        } else {
            mat::outer(dw, accumulate, dy, x, self.n_out, self.n_in, first);
        }
    }
}
