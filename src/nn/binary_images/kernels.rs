//! The inner loops of a first layer on images, for every instruction set.
//!
//! Every output is one chain of fused multiply-adds over an image's changes. The width of vectors changes no bit.

use pulp::{Simd, WithSimd};

use super::{BinaryImages, OutputRows, WHITE};
use crate::{
    nn::{mat::Accumulate, mlp::Linear},
    num::Real,
};

/// Vectors of outputs that one pass over the changes keeps in registers. Columns of W this wide stay in the second-level
/// cache.
const VECTORS: usize = 4;

/// Covers `width` outputs with runs of `VECTORS` vectors, then with single vectors (`run`), then with single numbers
/// (`rest`). Each call gets the first output of its part.
macro_rules! in_runs {
    ($self:ident, $simd:ident, $width:expr, $lanes:expr) => {{
        let (width, lanes) = ($width, $lanes);
        let mut at = 0;
        while at + VECTORS * lanes <= width {
            $self.run::<S, VECTORS>($simd, at);
            at += VECTORS * lanes;
        }
        while at + lanes <= width {
            $self.run::<S, 1>($simd, at);
            at += lanes;
        }
        $self.rest(at);
    }};
}

/// The operands of [`BinaryImages::affine`].
pub(super) struct Affine<'a, T> {
    pub(super) images: &'a BinaryImages,
    pub(super) layer: &'a Linear,
    pub(super) w: &'a [T],
    pub(super) base: &'a [T],
    pub(super) which: &'a [u32],
    pub(super) y: &'a mut [T],
    pub(super) rows: OutputRows,
    pub(super) relu: bool,
}

impl<T: Real> WithSimd for Affine<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        in_runs!(self, simd, self.layer.n_out, T::lanes::<S>());
    }
}

impl<T: Real> Affine<'_, T> {
    /// The entries that the layer reads.
    fn entries(&self) -> std::ops::Range<usize> {
        self.rows.first_entry..self.rows.first_entry + self.layer.n_in
    }

    #[inline(always)]
    fn run<S: Simd, const V: usize>(&mut self, simd: S, at: usize) {
        let (n_out, lanes) = (self.layer.n_out, T::lanes::<S>());
        let entries = self.entries();
        let base = T::registers::<S>(&self.base[at..at + V * lanes]);
        let values = self.images.level_values();
        let zero = T::splat(simd, T::ZERO);
        for (&image, y) in self.which.iter().zip(self.y.chunks_exact_mut(self.rows.stride)) {
            let mut sums: [T::V<S>; V] = std::array::from_fn(|v| base[v]);
            for &change in self.images.changes_at(image, entries.clone()) {
                let value = T::splat(simd, values.of(change));
                let column = change.entry() - self.rows.first_entry;
                let w = T::registers::<S>(&self.w[column * n_out + at..][..V * lanes]);
                for v in 0..V {
                    sums[v] = T::mul_add(simd, value, w[v], sums[v]);
                }
            }
            let y = T::registers_mut::<S>(&mut y[self.rows.offset + at..][..V * lanes]);
            for v in 0..V {
                y[v] = if self.relu { T::max(simd, sums[v], zero) } else { sums[v] };
            }
        }
    }

    #[inline(always)]
    fn rest(&mut self, at: usize) {
        let (n_out, values, entries) = (self.layer.n_out, self.images.level_values::<T>(), self.entries());
        for (&image, y) in self.which.iter().zip(self.y.chunks_exact_mut(self.rows.stride)) {
            let y = &mut y[self.rows.offset..][at..n_out];
            y.copy_from_slice(&self.base[at..]);
            for &change in self.images.changes_at(image, entries.clone()) {
                let (value, column) = (values.of(change), change.entry() - self.rows.first_entry);
                for (y, &w) in y.iter_mut().zip(&self.w[column * n_out + at..]) {
                    *y = value.fma(w, *y);
                }
            }
            if self.relu {
                for y in y {
                    *y = y.larger(T::ZERO);
                }
            }
        }
    }
}

/// The operands of [`BinaryImages::gradient`] for the columns of dW that belong to the entries from `first` on.
pub(super) struct WeightGradient<'a, T> {
    pub(super) images: &'a BinaryImages,
    pub(super) n_out: usize,
    pub(super) dw: &'a mut [T],
    pub(super) db: &'a [T],
    pub(super) accumulate: Accumulate,
    pub(super) which: &'a [u32],
    pub(super) dy: &'a [T],
    pub(super) rows: OutputRows,
    pub(super) first: usize,
}

impl<T: Real> WithSimd for WeightGradient<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        in_runs!(self, simd, self.n_out, T::lanes::<S>());
    }
}

impl<T: Real> WeightGradient<'_, T> {
    /// The entries whose columns these are.
    fn entries(&self) -> std::ops::Range<usize> {
        self.first..self.first + self.dw.len() / self.n_out
    }

    /// Sets the start of every column: an entry has the reference's value in all images, apart from changes.
    /// If gradients are added, the columns stay as they are.
    #[inline(always)]
    fn start(&mut self, at: usize, len: usize) {
        if self.accumulate == Accumulate::Add {
            return;
        }
        let reference = &self.images.reference;
        for (entry, dw) in (self.first..).zip(self.dw.chunks_exact_mut(self.n_out)) {
            let dw = &mut dw[at..at + len];
            match reference.bytes[entry] {
                0 => dw.fill(T::ZERO),
                WHITE => dw.copy_from_slice(&self.db[at..at + len]),
                _ => {
                    let value: T = reference.value(entry);
                    dw.iter_mut().zip(&self.db[at..at + len]).for_each(|(dw, &db)| *dw = value * db);
                }
            }
        }
    }

    #[inline(always)]
    fn run<S: Simd, const V: usize>(&mut self, simd: S, at: usize) {
        let (images, lanes) = (self.images, T::lanes::<S>());
        let values = images.level_values();
        self.start(at, V * lanes);
        for (&image, dy) in self.which.iter().zip(self.dy.chunks_exact(self.rows.stride)) {
            let dy = T::registers::<S>(&dy[self.rows.offset + at..][..V * lanes]);
            let dy: [T::V<S>; V] = std::array::from_fn(|v| dy[v]);
            for &change in images.changes_at(image, self.entries()) {
                let value = T::splat(simd, values.of(change));
                let entry = change.entry() - self.first;
                let dw = T::registers_mut::<S>(&mut self.dw[entry * self.n_out + at..][..V * lanes]);
                for v in 0..V {
                    dw[v] = T::mul_add(simd, value, dy[v], dw[v]);
                }
            }
        }
    }

    #[inline(always)]
    fn rest(&mut self, at: usize) {
        let (images, n_out, values) = (self.images, self.n_out, self.images.level_values::<T>());
        self.start(at, n_out - at);
        for (&image, dy) in self.which.iter().zip(self.dy.chunks_exact(self.rows.stride)) {
            let dy = &dy[self.rows.offset..][at..n_out];
            for &change in images.changes_at(image, self.entries()) {
                let (entry, value) = (change.entry() - self.first, values.of(change));
                for (dw, &dy) in self.dw[entry * n_out..][at..n_out].iter_mut().zip(dy) {
                    *dw = value.fma(dy, *dw);
                }
            }
        }
    }
}
