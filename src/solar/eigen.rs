//! Eigenvalues of small symmetric matrices, by Jacobi rotations.

use super::Small;

/// Sweeps over all pairs. Convergence is quadratic, so that ten are plenty.
const SWEEPS: usize = 30;

/// The eigenvalues of a symmetric matrix, and its eigenvectors as columns.
pub(super) fn eigen(matrix: &Small) -> (Vec<f64>, Small) {
    let n = matrix.rows();
    let (mut a, mut vectors) = (*matrix, Small::diagonal(n, 1.0));
    for _ in 0..SWEEPS {
        for (i, j) in (0..n).flat_map(|i| (i + 1..n).map(move |j| (i, j))) {
            if a.at(i, j) == 0.0 {
                continue;
            }
            let theta = (a.at(j, j) - a.at(i, i)) / (2.0 * a.at(i, j));
            let tangent = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
            let cosine = 1.0 / (tangent * tangent + 1.0).sqrt();
            let sine = tangent * cosine;
            for k in 0..n {
                rotate(&mut a, (k, i), (k, j), cosine, sine);
            }
            for k in 0..n {
                rotate(&mut a, (i, k), (j, k), cosine, sine);
                rotate(&mut vectors, (k, i), (k, j), cosine, sine);
            }
            (*a.at_mut(i, j), *a.at_mut(j, i)) = (0.0, 0.0);
        }
    }
    ((0..n).map(|i| a.at(i, i)).collect(), vectors)
}

fn rotate(of: &mut Small, x: (usize, usize), y: (usize, usize), cosine: f64, sine: f64) {
    let (at_x, at_y) = (of.at(x.0, x.1), of.at(y.0, y.1));
    *of.at_mut(x.0, x.1) = cosine * at_x - sine * at_y;
    *of.at_mut(y.0, y.1) = sine * at_x + cosine * at_y;
}

/// The nearest positive semidefinite matrix: eigenvalues below 0 become 0.
pub(super) fn positive_part(matrix: &Small) -> Small {
    let (values, vectors) = eigen(matrix);
    let n = values.len();
    let scaled = Small::from_fn(n, n, |i, k| vectors.at(i, k) * values[k].max(0.0));
    scaled.times_transposed(&vectors).symmetric()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eigenvectors_and_eigenvalues_make_the_matrix() {
        let a = Small::from_rows(3, 3, &[4.0, 2.0, -1.0, 2.0, 5.0, 0.5, -1.0, 0.5, -3.0]);
        let (values, vectors) = eigen(&a);
        let scaled = Small::from_fn(3, 3, |i, k| vectors.at(i, k) * values[k]);
        let rest = scaled.times_transposed(&vectors).plus(-1.0, &a);
        assert!(rest.iter().all(|x| x.abs() < 1e-14), "{rest:?}");
        assert!(values.iter().any(|&value| value < 0.0));
        assert_eq!(positive_part(&Small::from_rows(2, 2, &[3.0, 0.0, 0.0, -1.0])).at(1, 1), 0.0);
    }
}
