//! A dense matrix and its Cholesky factor.

/// A dense matrix, stored row by row.
#[derive(Debug, Clone, PartialEq)]
pub struct Matrix {
    columns: usize,
    entries: Vec<f64>,
}

impl Matrix {
    /// A matrix with these entries, row by row.
    pub fn new(columns: usize, entries: Vec<f64>) -> Self {
        assert!(columns > 0 && entries.len().is_multiple_of(columns), "whole rows");
        Self { columns, entries }
    }

    /// A matrix of one column.
    pub fn column(entries: Vec<f64>) -> Self {
        Self::new(1, entries)
    }

    /// `value` times the identity.
    pub fn diagonal(width: usize, value: f64) -> Self {
        let entry = |at: usize| if at.is_multiple_of(width + 1) { value } else { 0.0 };
        Self::new(width, (0..width * width).map(entry).collect())
    }

    /// Columns.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// The entry of a row and a column.
    pub fn of(&self, row: usize, column: usize) -> f64 {
        self.entries[row * self.columns + column]
    }

    /// Rows.
    pub fn rows(&self) -> usize {
        self.entries.len() / self.columns
    }

    /// A matrix by its entries.
    pub fn from_fn(rows: usize, columns: usize, entry: impl Fn(usize, usize) -> f64) -> Self {
        Self::new(columns, (0..rows * columns).map(|at| entry(at / columns, at % columns)).collect())
    }

    /// self · other.
    pub fn times(&self, other: &Self) -> Self {
        assert_eq!(self.columns, other.rows(), "shapes of a product");
        Self::from_fn(self.rows(), other.columns, |i, j| {
            (0..self.columns).map(|k| self.of(i, k) * other.of(k, j)).sum()
        })
    }

    /// selfᵀ · other.
    pub fn transposed_times(&self, other: &Self) -> Self {
        assert_eq!(self.rows(), other.rows(), "shapes of a product");
        Self::from_fn(self.columns, other.columns, |i, j| {
            (0..self.rows()).map(|k| self.of(k, i) * other.of(k, j)).sum()
        })
    }

    /// self + other.
    pub fn plus(&self, other: &Self) -> Self {
        assert_eq!((self.rows(), self.columns), (other.rows(), other.columns), "shapes of a sum");
        Self::new(self.columns, self.entries.iter().zip(&other.entries).map(|(a, b)| a + b).collect())
    }

    /// -self.
    pub fn negative(&self) -> Self {
        Self::new(self.columns, self.entries.iter().map(|entry| -entry).collect())
    }

    /// The Cholesky factor: the lower triangular L with L Lᵀ = self. `None` unless self, which must be symmetric, is
    /// positive definite.
    pub fn cholesky(&self) -> Option<Self> {
        let n = self.columns;
        let mut root = Self::diagonal(n, 0.0);
        for i in 0..n {
            for j in 0..=i {
                let rest = self.of(i, j) - (0..j).map(|k| root.of(i, k) * root.of(j, k)).sum::<f64>();
                root.entries[i * n + j] = if i > j {
                    rest / root.of(j, j)
                } else if rest.is_finite() && rest > 0.0 {
                    rest.sqrt()
                } else {
                    return None;
                };
            }
        }
        Some(root)
    }

    /// (L Lᵀ)⁻¹ · other, where self is a Cholesky factor L.
    pub fn solve_from_root(&self, other: &Self) -> Self {
        let (n, columns) = (self.columns, other.columns);
        let mut x = other.clone();
        for j in 0..columns {
            for i in 0..n {
                let known: f64 = (0..i).map(|k| self.of(i, k) * x.of(k, j)).sum();
                x.entries[i * columns + j] = (x.of(i, j) - known) / self.of(i, i);
            }
            for i in (0..n).rev() {
                let known: f64 = (i + 1..n).map(|k| self.of(k, i) * x.of(k, j)).sum();
                x.entries[i * columns + j] = (x.of(i, j) - known) / self.of(i, i);
            }
        }
        x
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_system_is_solved_by_its_cholesky_factor() {
        let matrix = Matrix::new(3, vec![4.0, 2.0, -1.0, 2.0, 5.0, 0.5, -1.0, 0.5, 3.0]);
        let x = Matrix::new(2, vec![1.0, -2.0, 0.5, 3.0, 7.0, 0.0]);
        let solved = matrix.cholesky().expect("positive definite").solve_from_root(&matrix.times(&x));
        assert!(solved.plus(&x.negative()).entries.iter().all(|rest| rest.abs() < 1e-14), "{solved:?}");
    }

    #[test]
    fn a_matrix_that_is_not_positive_definite_has_no_cholesky_factor() {
        assert_eq!(Matrix::new(2, vec![1.0, 2.0, 2.0, 1.0]).cholesky(), None);
        assert_eq!(Matrix::new(1, vec![f64::NAN]).cholesky(), None);
        assert_eq!(Matrix::new(1, vec![f64::INFINITY]).cholesky(), None);
    }

    #[test]
    fn a_transposed_product_is_the_product_with_the_transpose() {
        let (a, b) = (Matrix::new(2, vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0]), Matrix::new(1, vec![1.0, -1.0, 2.0]));
        assert_eq!(a.transposed_times(&b), Matrix::new(3, vec![1.0, 3.0, 5.0, 2.0, 4.0, 6.0]).times(&b));
        assert_eq!(a.transposed_times(&b), Matrix::column(vec![8.0, 10.0]));
    }
}
