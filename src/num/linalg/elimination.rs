//! Solvers by Gaussian elimination.

/// Below this, a pivot counts as zero.
const SMALLEST_PIVOT: f64 = 1e-12;

/// Solves a x = b, where only the first `n` rows and columns count. `a` is positive definite, so no rows are exchanged.
pub fn solve_positive_definite<const N: usize>(mut a: [[f64; N]; N], mut b: [f64; N], n: usize) -> [f64; N] {
    for pivot in 0..n {
        for row in pivot + 1..n {
            let share = a[row][pivot] / a[pivot][pivot];
            for column in pivot..n {
                a[row][column] -= share * a[pivot][column];
            }
            b[row] -= share * b[pivot];
        }
    }
    for row in (0..n).rev() {
        for column in row + 1..n {
            b[row] -= a[row][column] * b[column];
        }
        b[row] /= a[row][row];
    }
    b
}

/// Solves A X = B by Gauss-Jordan elimination with partial pivoting. Each row of `equations` is a row of A followed by the
/// same row of B. Returns the rows of X, or `None` if A is singular.
pub fn solve_augmented(mut equations: Vec<Vec<f64>>) -> Option<Vec<Vec<f64>>> {
    let n = equations.len();
    for pivot in 0..n {
        let best = (pivot..n).max_by(|&a, &b| equations[a][pivot].abs().total_cmp(&equations[b][pivot].abs()));
        equations.swap(pivot, best.unwrap_or(pivot));
        if equations[pivot][pivot].abs() < SMALLEST_PIVOT {
            return None;
        }
        let lead = equations[pivot].clone();
        for (row, equation) in equations.iter_mut().enumerate() {
            if row != pivot {
                let share = equation[pivot] / lead[pivot];
                equation.iter_mut().zip(&lead).for_each(|(entry, lead)| *entry -= share * lead);
            }
        }
    }
    let solved = equations.iter().enumerate();
    Some(solved.map(|(row, equation)| equation[n..].iter().map(|entry| entry / equation[row]).collect()).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_solvers_solve_a_system_with_a_known_solution() {
        let a = [[4.0, 2.0, -1.0], [2.0, 5.0, 0.5], [-1.0, 0.5, 3.0]];
        let x = [1.0, -2.0, 0.5];
        let b = a.map(|row| row.iter().zip(x).map(|(a, x)| a * x).sum::<f64>());
        let eliminated = solve_positive_definite(a, b, 3);
        let augmented = solve_augmented(a.iter().zip(b).map(|(row, b)| [&row[..], &[b]].concat()).collect()).unwrap();
        for i in 0..3 {
            assert!((eliminated[i] - x[i]).abs() < 1e-14 && (augmented[i][0] - x[i]).abs() < 1e-14);
        }
    }

    #[test]
    fn only_the_leading_part_of_a_larger_matrix_counts() {
        let solved = solve_positive_definite([[2.0, 0.0, 9.0], [0.0, 4.0, 9.0], [9.0; 3]], [2.0, 2.0, 7.0], 2);
        assert_eq!(solved[..2], [1.0, 0.5]);
    }

    #[test]
    fn rows_are_exchanged_and_singular_matrices_refused() {
        let exchanged = solve_augmented(vec![vec![0.0, 2.0, 6.0], vec![1.0, 1.0, 5.0]]);
        assert_eq!(exchanged, Some(vec![vec![2.0], vec![3.0]]));
        assert_eq!(solve_augmented(vec![vec![1.0, 1.0, 1.0], vec![1.0, 1.0, 2.0]]), None);
    }
}
