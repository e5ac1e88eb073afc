//! A network's first layer on images: forward pass and weight gradient.

use super::{
    BinaryImages,
    kernels::{Affine, WeightGradient},
};
use crate::{
    nn::{mat::Accumulate, mlp::Linear},
    num::{
        Real, join,
        simd::{arch, vectorize},
    },
};

/// The rows of a longer column that hold a layer's outputs, and the entries of an image that the layer reads.
#[derive(Debug, Clone, Copy)]
pub struct OutputRows {
    /// Length of the column.
    pub stride: usize,
    /// The first of the layer's rows.
    pub offset: usize,
    /// The first entry that the layer reads: 0 unless it reads one of several frames.
    pub first_entry: usize,
}

impl BinaryImages {
    /// Computes W x_reference + b, the start of every column that [`BinaryImages::affine`] computes. If a layer reads
    /// single frames, the reference must be dark.
    pub fn base<T: Real>(&self, layer: &Linear, arena: &[T], base: &mut [T]) {
        base.copy_from_slice(layer.b(arena));
        for entry in self.reference_lit() {
            add(base, self.reference.value(entry), &layer.w(arena)[entry * layer.n_out..][..layer.n_out]);
        }
    }

    /// Computes y = W x + b for the images `which`, followed by a ReLU if `relu` is set. Each image has one column of
    /// `y`; `rows` are the layer's rows of it. `base` comes from [`BinaryImages::base`].
    #[allow(clippy::too_many_arguments, reason = "a matrix product names its operands and where its result goes")]
    pub fn affine<T: Real>(
        &self,
        layer: &Linear,
        arena: &[T],
        base: &[T],
        which: &[u32],
        y: &mut [T],
        rows: OutputRows,
        relu: bool,
    ) {
        arch().dispatch(Affine { images: self, layer, w: layer.w(arena), base, which, y, rows, relu });
    }

    /// Sets or adds dW = Σ dy xᵀ and db = Σ dy over the images `which`. Columns of `dy` are laid out like those of `y` in
    /// [`BinaryImages::affine`]. For `Accumulate::Add`, the reference must be dark.
    #[allow(clippy::too_many_arguments, reason = "a matrix product names its operands and where its result goes")]
    pub fn gradient<T: Real>(
        &self,
        threads: usize,
        layer: &Linear,
        gradient: &mut [T],
        accumulate: Accumulate,
        which: &[u32],
        dy: &[T],
        rows: OutputRows,
    ) {
        let (dw, db) = layer.w_b_mut(gradient);
        if accumulate == Accumulate::Replace {
            db.fill(T::ZERO);
        }
        for dy in dy.chunks_exact(rows.stride) {
            add(db, T::ONE, &dy[rows.offset..rows.offset + layer.n_out]);
        }
        self.weight_gradient(threads, layer, dw, db, accumulate, which, dy, rows, 0);
    }

    /// Sets or adds the columns of dW from column `first` on.
    #[allow(clippy::too_many_arguments, reason = "the recursion passes on all arguments of its caller")]
    fn weight_gradient<T: Real>(
        &self,
        threads: usize,
        layer: &Linear,
        dw: &mut [T],
        db: &[T],
        accumulate: Accumulate,
        which: &[u32],
        dy: &[T],
        rows: OutputRows,
        first: usize,
    ) {
        let columns = dw.len() / layer.n_out;
        if threads > 1 && columns > 1 {
            let (left, right) = dw.split_at_mut(columns / 2 * layer.n_out);
            let (half, rest) = (threads / 2, threads - threads / 2);
            join(
                threads,
                || self.weight_gradient(half, layer, left, db, accumulate, which, dy, rows, first),
                || self.weight_gradient(rest, layer, right, db, accumulate, which, dy, rows, first + columns / 2),
            );
            return;
        }
        let first = rows.first_entry + first;
        arch().dispatch(WeightGradient {
            images: self,
            n_out: layer.n_out,
            dw,
            db,
            accumulate,
            which,
            dy,
            rows,
            first,
        });
    }
}

/// y += factor x.
fn add<T: Real>(y: &mut [T], factor: T, x: &[T]) {
    vectorize(
        #[inline(always)]
        || {
            for (y, &x) in y.iter_mut().zip(x) {
                *y = factor.fma(x, *y);
            }
        },
    );
}
