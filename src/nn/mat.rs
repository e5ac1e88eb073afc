//! Products of dense matrices. This is the only module that calls faer.
//!
//! Matrices are column-major slices with one sample per column. Every number of a product is one chain of fused
//! multiply-adds over the inner dimension, so splitting rows or columns over threads changes no bit. faer's kernels for a
//! single row or column do not have this property, so these shapes have their own loops here.

use faer::{Accum, MatMut, MatRef, Par, linalg::matmul::matmul};

use crate::num::Real;

/// Whether a product replaces the output or is added to it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Accumulate {
    /// out = product
    Replace,
    /// out += product
    Add,
}

fn accum(accumulate: Accumulate) -> Accum {
    match accumulate {
        Accumulate::Replace => Accum::Replace,
        Accumulate::Add => Accum::Add,
    }
}

/// out \[m, n\] = w \[m, k\] x \[k, n\].
pub fn product<T: Real>(out: &mut [T], accumulate: Accumulate, w: &[T], x: &[T], (m, k, n): (usize, usize, usize)) {
    assert!(out.len() == m * n && w.len() == m * k && x.len() == k * n, "shapes of a product");
    if n == 0 {
        return;
    }
    if m == 1 {
        for (y, x) in out.iter_mut().zip(x.chunks_exact(k)) {
            let dot = dot(w, x);
            *y = if accumulate == Accumulate::Add { *y + dot } else { dot };
        }
    } else if n == 1 {
        if accumulate == Accumulate::Replace {
            out.fill(T::ZERO);
        }
        crate::num::simd::vectorize(
            #[inline(always)]
            || {
                for (w, &x) in w.chunks_exact(m).zip(x) {
                    for (y, &w) in out.iter_mut().zip(w) {
                        *y = w.fma(x, *y);
                    }
                }
            },
        );
    } else {
        let out = MatMut::from_column_major_slice_mut(out, m, n);
        let w = MatRef::from_column_major_slice(w, m, k);
        let x = MatRef::from_column_major_slice(x, k, n);
        matmul(out, accum(accumulate), w, x, T::ONE, Par::Seq);
    }
}

/// out \[k, n\] = wᵀ dy for w \[m, k\] and dy \[m, n\].
pub fn product_transposed<T: Real>(
    out: &mut [T],
    accumulate: Accumulate,
    w: &[T],
    dy: &[T],
    (m, k, n): (usize, usize, usize),
) {
    assert!(out.len() == k * n && w.len() == m * k && dy.len() == m * n, "shapes of a product");
    if n == 0 {
        return;
    }
    if m == 1 {
        for (out, &dy) in out.chunks_exact_mut(k).zip(dy) {
            for (x, &w) in out.iter_mut().zip(w) {
                *x = if accumulate == Accumulate::Add { w.fma(dy, *x) } else { w * dy };
            }
        }
    } else if n == 1 || k == 1 {
        for (out, dy) in out.chunks_exact_mut(k).zip(dy.chunks_exact(m)) {
            for (x, w) in out.iter_mut().zip(w.chunks_exact(m)) {
                let dot = dot(w, dy);
                *x = if accumulate == Accumulate::Add { *x + dot } else { dot };
            }
        }
    } else {
        let out = MatMut::from_column_major_slice_mut(out, k, n);
        let w = MatRef::from_column_major_slice(w, m, k);
        let dy = MatRef::from_column_major_slice(dy, m, n);
        matmul(out, accum(accumulate), w.transpose(), dy, T::ONE, Par::Seq);
    }
}

/// The columns of dy xᵀ from `first` on: dw \[m, k'\] = dy \[m, n\] (rows first..first+k' of x \[k, n\])ᵀ.
pub fn outer<T: Real>(dw: &mut [T], accumulate: Accumulate, dy: &[T], x: &[T], m: usize, k: usize, first: usize) {
    let columns = dw.len() / m;
    let n = dy.len() / m;
    assert!(dw.len() == m * columns && x.len() == k * n && first + columns <= k, "shapes of an outer product");
    if columns == 0 {
        return;
    }
    if m == 1 || columns == 1 || n == 1 {
        if accumulate == Accumulate::Replace {
            dw.fill(T::ZERO);
        }
        crate::num::simd::vectorize(
            #[inline(always)]
            || {
                if m == 1 {
                    for (x, &dy) in x.chunks_exact(k).zip(dy) {
                        for (dw, &x) in dw.iter_mut().zip(&x[first..]) {
                            *dw = dy.fma(x, *dw);
                        }
                    }
                } else {
                    for (x, dy) in x.chunks_exact(k).zip(dy.chunks_exact(m)) {
                        for (dw, &x) in dw.chunks_exact_mut(m).zip(&x[first..]) {
                            for (dw, &dy) in dw.iter_mut().zip(dy) {
                                *dw = dy.fma(x, *dw);
                            }
                        }
                    }
                }
            },
        );
    } else {
        let dw = MatMut::from_column_major_slice_mut(dw, m, columns);
        let dy = MatRef::from_column_major_slice(dy, m, n);
        let x = MatRef::from_column_major_slice(x, k, n).subrows(first, columns);
        matmul(dw, accum(accumulate), dy, x.transpose(), T::ONE, Par::Seq);
    }
}

/// A dot product, as sixteen interleaved chains that are added in order.
fn dot<T: Real>(a: &[T], b: &[T]) -> T {
    let mut lanes = [T::ZERO; 16];
    let (a16, a_rest) = a.as_chunks::<16>();
    let (b16, b_rest) = b.as_chunks::<16>();
    crate::num::simd::vectorize(
        #[inline(always)]
        || {
            for (a, b) in a16.iter().zip(b16) {
                for i in 0..16 {
                    lanes[i] = a[i].fma(b[i], lanes[i]);
                }
            }
        },
    );
    let mut sum = lanes.into_iter().fold(T::ZERO, |sum, lane| sum + lane);
    for (&a, &b) in a_rest.iter().zip(b_rest) {
        sum = a.fma(b, sum);
    }
    sum
}

#[cfg(test)]
mod tests {
    use rand::{RngExt as _, SeedableRng as _};

    use super::*;

    fn random<T: Real>(len: usize, seed: u64) -> Vec<T> {
        let mut rng = crate::num::rng::Rng::seed_from_u64(seed);
        (0..len).map(|_| T::of(rng.random_range(-1.0..1.0))).collect()
    }

    fn naive(w: &[f64], x: &[f64], (m, k, n): (usize, usize, usize)) -> Vec<f64> {
        let mut out = vec![0.0; m * n];
        for (j, i, l) in (0..n).flat_map(|j| (0..m).flat_map(move |i| (0..k).map(move |l| (j, i, l)))) {
            out[j * m + i] += w[l * m + i] * x[j * k + l];
        }
        out
    }

    #[test]
    fn products_equal_the_plain_sum_in_every_shape() {
        for shape @ (m, k, n) in [(1, 7, 5), (5, 7, 1), (3, 1, 4), (20, 4, 9), (33, 600, 17), (2, 40, 3)] {
            let (w, x, dy) = (random::<f64>(m * k, 1), random::<f64>(k * n, 2), random::<f64>(m * n, 3));
            let near = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-11);
            let mut out = vec![9.0; m * n];
            product(&mut out, Accumulate::Replace, &w, &x, shape);
            assert!(near(&out, &naive(&w, &x, shape)), "{shape:?}");
            // <dy, W x> = <Wᵀ dy, x> = <dy xᵀ, W>: both transposes against the product.
            let inner = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
            let mut back = vec![9.0; k * n];
            product_transposed(&mut back, Accumulate::Replace, &w, &dy, shape);
            assert!((inner(&dy, &out) - inner(&back, &x)).abs() < 1e-9, "{shape:?}");
            let mut dw = vec![9.0; m * k];
            outer(&mut dw, Accumulate::Replace, &dy, &x, m, k, 0);
            assert!((inner(&dy, &out) - inner(&dw, &w)).abs() < 1e-9, "{shape:?}");
        }
    }

    #[test]
    fn splitting_columns_changes_no_bit() {
        for (m, k, n) in
            [(300, 300, 256), (1600, 300, 96), (20, 4, 640), (4, 300, 128), (256, 256, 128), (100, 110, 64)]
        {
            let (w, x) = (random::<f32>(m * k, 1), random::<f32>(k * n, 2));
            let mut whole = vec![0.0; m * n];
            product(&mut whole, Accumulate::Replace, &w, &x, (m, k, n));
            for parts in [2, 3, 4, 8] {
                let mut split = vec![0.0; m * n];
                for part in 0..parts {
                    let (low, high) = (n * part / parts, n * (part + 1) / parts);
                    let shape = (m, k, high - low);
                    product(&mut split[low * m..high * m], Accumulate::Replace, &w, &x[low * k..high * k], shape);
                }
                assert!(whole == split, "{m}x{k}x{n} in {parts} parts");
            }
            let dy = random::<f32>(m * n, 3);
            let (mut whole, mut split) = (vec![0.0; m * k], vec![0.0; m * k]);
            outer(&mut whole, Accumulate::Replace, &dy, &x, m, k, 0);
            let (left, right) = split.split_at_mut(k / 2 * m);
            outer(left, Accumulate::Replace, &dy, &x, m, k, 0);
            outer(right, Accumulate::Replace, &dy, &x, m, k, k / 2);
            assert!(whole == split, "outer {m}x{k}x{n}");
        }
    }
}
