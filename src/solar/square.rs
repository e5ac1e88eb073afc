//! Square matrices whose size is known when the program is compiled: the arithmetic of the chain.

/// A D x D matrix, row by row.
pub(super) type Square<const D: usize> = [[f64; D]; D];
/// A column.
pub(super) type Vector<const D: usize> = [f64; D];

/// a + b.
#[inline(always)]
pub(super) fn sum<const D: usize>(a: &Vector<D>, b: &Vector<D>) -> Vector<D> {
    std::array::from_fn(|i| a[i] + b[i])
}

/// <a, b>.
#[inline(always)]
pub(super) fn dot<const D: usize>(a: &Vector<D>, b: &Vector<D>) -> f64 {
    (0..D).map(|i| a[i] * b[i]).sum()
}

/// A x.
#[inline(always)]
pub(super) fn apply<const D: usize>(a: &Square<D>, x: &Vector<D>) -> Vector<D> {
    std::array::from_fn(|i| dot(&a[i], x))
}

/// Aᵀ x.
#[inline(always)]
pub(super) fn apply_transposed<const D: usize>(a: &Square<D>, x: &Vector<D>) -> Vector<D> {
    let mut y = [0.0; D];
    for i in 0..D {
        for j in 0..D {
            y[j] += a[i][j] * x[i];
        }
    }
    y
}

/// Aᵀ.
#[inline(always)]
pub(super) fn transposed<const D: usize>(a: &Square<D>) -> Square<D> {
    std::array::from_fn(|i| std::array::from_fn(|j| a[j][i]))
}

/// A B.
#[inline(always)]
pub(super) fn times<const D: usize>(a: &Square<D>, b: &Square<D>) -> Square<D> {
    std::array::from_fn(|i| {
        let mut row = [0.0; D];
        for k in 0..D {
            for j in 0..D {
                row[j] += a[i][k] * b[k][j];
            }
        }
        row
    })
}

/// A + scale B.
#[inline(always)]
pub(super) fn plus<const D: usize>(a: &Square<D>, scale: f64, b: &Square<D>) -> Square<D> {
    std::array::from_fn(|i| std::array::from_fn(|j| a[i][j] + scale * b[i][j]))
}

/// (A + Aᵀ) / 2.
#[inline(always)]
pub(super) fn symmetric<const D: usize>(a: &Square<D>) -> Square<D> {
    std::array::from_fn(|i| std::array::from_fn(|j| 0.5 * (a[i][j] + a[j][i])))
}

/// (a bᵀ + b aᵀ) / 2.
#[inline(always)]
pub(super) fn symmetric_outer<const D: usize>(a: &Vector<D>, b: &Vector<D>) -> Square<D> {
    std::array::from_fn(|i| std::array::from_fn(|j| 0.5 * (a[i] * b[j] + b[i] * a[j])))
}

/// The lower Cholesky factor C of Q⁻¹, and ln|Q|. Entries are NaN if Q is not positive definite.
///
/// Q = R Rᵀ with R upper triangular gives C = R⁻ᵀ, so Q is never inverted first.
#[inline(always)]
pub(super) fn root_of_inverse<const D: usize>(q: &Square<D>) -> (Square<D>, f64) {
    // Rᵀ, which is lower triangular, with the reciprocals of its diagonal.
    let mut root = [[0.0; D]; D];
    let (mut reciprocal, mut product) = ([0.0; D], 1.0);
    for j in (0..D).rev() {
        let known: f64 = (j + 1..D).map(|k| root[k][j] * root[k][j]).sum();
        let pivot = (q[j][j] - known).sqrt();
        (root[j][j], reciprocal[j]) = (pivot, 1.0 / pivot);
        product *= pivot;
        for i in 0..j {
            let known: f64 = (j + 1..D).map(|k| root[k][i] * root[k][j]).sum();
            root[j][i] = (q[i][j] - known) * reciprocal[j];
        }
    }
    let mut inverse = [[0.0; D]; D];
    for i in 0..D {
        let mut row = [0.0; D];
        for k in 0..i {
            for j in 0..D {
                row[j] += root[i][k] * inverse[k][j];
            }
        }
        inverse[i] = row.map(|known| -known * reciprocal[i]);
        inverse[i][i] = reciprocal[i];
    }
    (inverse, 2.0 * libm::log(product))
}
