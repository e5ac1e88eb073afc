//! Small matrices on the stack, whose sizes are known at run time.

use std::ops::Range;

/// The most rows and columns.
pub const MOST: usize = 12;

/// A matrix of at most [`MOST`] rows and columns.
#[derive(Clone, Copy, PartialEq)]
pub struct Small {
    rows: usize,
    columns: usize,
    entries: [[f64; MOST]; MOST],
}

impl std::fmt::Debug for Small {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_list().entries((0..self.rows).map(|i| self.row(i))).finish()
    }
}

impl Small {
    /// Zeros.
    ///
    /// # Panics
    /// If there are more than [`MOST`] rows or columns.
    pub fn zeros(rows: usize, columns: usize) -> Self {
        assert!(rows <= MOST && columns <= MOST, "a small matrix of {rows} x {columns}");
        Self { rows, columns, entries: [[0.0; MOST]; MOST] }
    }

    /// A matrix by its entries.
    pub fn from_fn(rows: usize, columns: usize, entry: impl Fn(usize, usize) -> f64) -> Self {
        let mut made = Self::zeros(rows, columns);
        for i in 0..rows {
            for j in 0..columns {
                made.entries[i][j] = entry(i, j);
            }
        }
        made
    }

    /// A matrix from its entries, row by row.
    pub fn from_rows(rows: usize, columns: usize, entries: &[f64]) -> Self {
        assert_eq!(entries.len(), rows * columns, "entries of a small matrix");
        Self::from_fn(rows, columns, |i, j| entries[i * columns + j])
    }

    /// A matrix of one column.
    pub fn column(entries: &[f64]) -> Self {
        Self::from_rows(entries.len(), 1, entries)
    }

    /// `value` times the identity.
    pub fn diagonal(n: usize, value: f64) -> Self {
        Self::from_fn(n, n, |i, j| if i == j { value } else { 0.0 })
    }

    /// Rows.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Columns.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// An entry.
    pub fn at(&self, i: usize, j: usize) -> f64 {
        self.entries[i][j]
    }

    /// An entry, to change.
    pub fn at_mut(&mut self, i: usize, j: usize) -> &mut f64 {
        &mut self.entries[i][j]
    }

    /// A row.
    pub fn row(&self, i: usize) -> &[f64] {
        &self.entries[i][..self.columns]
    }

    /// The entries, row by row.
    pub fn iter(&self) -> impl Iterator<Item = f64> + '_ {
        (0..self.rows).flat_map(|i| self.row(i).iter().copied())
    }

    /// Some rows and columns.
    pub fn block(&self, rows: Range<usize>, columns: Range<usize>) -> Self {
        Self::from_fn(rows.len(), columns.len(), |i, j| self.at(rows.start + i, columns.start + j))
    }

    /// Writes a block whose first entry is at (row, column).
    pub fn set_block(&mut self, row: usize, column: usize, block: &Self) {
        for i in 0..block.rows {
            self.entries[row + i][column..column + block.columns].copy_from_slice(block.row(i));
        }
    }

    /// The transpose.
    pub fn transposed(&self) -> Self {
        Self::from_fn(self.columns, self.rows, |i, j| self.at(j, i))
    }

    /// self · other.
    pub fn times(&self, other: &Self) -> Self {
        debug_assert_eq!(self.columns, other.rows, "shapes of a product");
        let mut product = Self::zeros(self.rows, other.columns);
        for i in 0..self.rows {
            for k in 0..self.columns {
                let factor = self.entries[i][k];
                for j in 0..other.columns {
                    product.entries[i][j] += factor * other.entries[k][j];
                }
            }
        }
        product
    }

    /// self · otherᵀ.
    pub fn times_transposed(&self, other: &Self) -> Self {
        self.times(&other.transposed())
    }

    /// selfᵀ · other.
    pub fn transposed_times(&self, other: &Self) -> Self {
        self.transposed().times(other)
    }

    /// self + scale · other.
    pub fn plus(&self, scale: f64, other: &Self) -> Self {
        debug_assert_eq!((self.rows, self.columns), (other.rows, other.columns), "shapes of a sum");
        Self::from_fn(self.rows, self.columns, |i, j| self.at(i, j) + scale * other.at(i, j))
    }

    /// scale · self.
    pub fn scaled(&self, scale: f64) -> Self {
        Self::from_fn(self.rows, self.columns, |i, j| scale * self.at(i, j))
    }

    /// (self + selfᵀ) / 2.
    pub fn symmetric(&self) -> Self {
        Self::from_fn(self.rows, self.rows, |i, j| 0.5 * (self.at(i, j) + self.at(j, i)))
    }

    /// The sum of the products of the entries, <self, other>.
    pub fn inner(&self, other: &Self) -> f64 {
        self.iter().zip(other.iter()).map(|(a, b)| a * b).sum()
    }

    /// The sum of the diagonal.
    pub fn trace(&self) -> f64 {
        (0..self.rows).map(|i| self.at(i, i)).sum()
    }

    /// xᵀ self x for a column x.
    pub fn quadratic(&self, x: &Self) -> f64 {
        x.inner(&self.times(x))
    }

    /// The Cholesky factor: the lower triangular L with L Lᵀ = self. `None` unless self is positive definite.
    pub fn cholesky(&self) -> Option<Self> {
        let n = self.rows;
        let mut root = Self::zeros(n, n);
        for i in 0..n {
            for j in 0..=i {
                let known: f64 = (0..j).map(|k| root.at(i, k) * root.at(j, k)).sum();
                let rest = self.at(i, j) - known;
                root.entries[i][j] = if i > j {
                    rest / root.at(j, j)
                } else if rest > 0.0 && rest.is_finite() {
                    rest.sqrt()
                } else {
                    return None;
                };
            }
        }
        Some(root)
    }

    /// The inverse and ln|self| of a positive definite matrix; `None` if it is not one.
    pub fn inverse(&self) -> Option<(Self, f64)> {
        let root = self.cholesky()?;
        let log_determinant = 2.0 * (0..self.rows).map(|i| libm::log(root.at(i, i))).sum::<f64>();
        let inverse_root = root.inverse_of_lower();
        Some((inverse_root.transposed_times(&inverse_root), log_determinant))
    }

    /// The inverse of a lower triangular matrix.
    pub fn inverse_of_lower(&self) -> Self {
        let n = self.rows;
        let mut inverse = Self::zeros(n, n);
        for j in 0..n {
            inverse.entries[j][j] = 1.0 / self.at(j, j);
            for i in j + 1..n {
                let known: f64 = (j..i).map(|k| self.at(i, k) * inverse.at(k, j)).sum();
                inverse.entries[i][j] = -known / self.at(i, i);
            }
        }
        inverse
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_matrix_times_its_inverse_is_the_identity() {
        let a = Small::from_rows(3, 3, &[4.0, 2.0, -1.0, 2.0, 5.0, 0.5, -1.0, 0.5, 3.0]);
        let (inverse, log_determinant) = a.inverse().expect("positive definite");
        let rest = a.times(&inverse).plus(-1.0, &Small::diagonal(3, 1.0));
        assert!(rest.iter().all(|x| x.abs() < 1e-15), "{rest:?}");
        assert!((log_determinant - 40.0_f64.ln()).abs() < 1e-14, "{log_determinant}");
        assert_eq!(Small::from_rows(2, 2, &[1.0, 2.0, 2.0, 1.0]).inverse(), None);
    }
}
