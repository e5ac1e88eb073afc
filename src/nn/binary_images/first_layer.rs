//! A network's first layer on binary images: forward pass and weight gradient.

use super::{
    BinaryImages,
    kernels::{Affine, WeightGradient},
};
use crate::{
    nn::mlp::Linear,
    num::{
        Real, join,
        simd::{arch, vectorize},
    },
};

/// The rows of a longer column that hold a layer's outputs.
#[derive(Debug, Clone, Copy)]
pub struct OutputRows {
    /// Length of the column.
    pub stride: usize,
    /// The first of the layer's rows.
    pub offset: usize,
}

impl BinaryImages {
    /// Computes W x_reference + b, the start of every column that [`BinaryImages::affine`] computes.
    pub fn base<T: Real>(&self, layer: &Linear, arena: &[T], base: &mut [T]) {
        base.copy_from_slice(layer.b(arena));
        for entry in self.reference_lit() {
            add(base, &layer.w(arena)[entry * layer.n_out..][..layer.n_out]);
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

    /// Sets dW = Σ dy xᵀ and db = Σ dy over the images `which`. Columns of `dy` are laid out like those of `y` in
    /// [`BinaryImages::affine`].
    pub fn gradient<T: Real>(
        &self,
        threads: usize,
        layer: &Linear,
        gradient: &mut [T],
        which: &[u32],
        dy: &[T],
        rows: OutputRows,
    ) {
        let (dw, db) = layer.w_b_mut(gradient);
        db.fill(T::ZERO);
        for dy in dy.chunks_exact(rows.stride) {
            add(db, &dy[rows.offset..rows.offset + layer.n_out]);
        }
        self.weight_gradient(threads, layer, dw, db, which, dy, rows, 0);
    }

    /// Sets the columns of dW for the entries from `first` on.
    #[allow(clippy::too_many_arguments, reason = "the recursion passes on all arguments of its caller")]
    fn weight_gradient<T: Real>(
        &self,
        threads: usize,
        layer: &Linear,
        dw: &mut [T],
        db: &[T],
        which: &[u32],
        dy: &[T],
        rows: OutputRows,
        first: usize,
    ) {
        let entries = dw.len() / layer.n_out;
        if threads > 1 && entries > 1 {
            let (left, right) = dw.split_at_mut(entries / 2 * layer.n_out);
            let (half, rest) = (threads / 2, threads - threads / 2);
            join(
                threads,
                || self.weight_gradient(half, layer, left, db, which, dy, rows, first),
                || self.weight_gradient(rest, layer, right, db, which, dy, rows, first + entries / 2),
            );
            return;
        }
        arch().dispatch(WeightGradient { images: self, n_out: layer.n_out, dw, db, which, dy, rows, first });
    }
}

fn add<T: Real>(y: &mut [T], x: &[T]) {
    vectorize(
        #[inline(always)]
        || {
            for (y, &x) in y.iter_mut().zip(x) {
                *y = T::ONE.fma(x, *y);
            }
        },
    );
}
