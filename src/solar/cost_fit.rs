//! The cost of the controller: least squares of ½ zᵀCz + cᵀz + b with C positive semidefinite, a convex problem with one
//! solution.
//!
//! The states are whitened first, which keeps C positive semidefinite and makes the problem well conditioned. The constraint
//! is met by ADMM: a least-squares step and a projection in turn.

use super::{Small, eigen::positive_part};

/// ADMM ends where both residuals are below this share of C.
const TOLERANCE: f64 = 1e-14;
/// The most steps of ADMM.
const MOST_STEPS: usize = 20_000;
/// A ridge on the covariance of the states, relative to its mean variance, for states that do not vary.
const RIDGE: f64 = 1e-12;

/// ½ zᵀCz + cᵀz + b.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StateCost {
    /// C \[d, d\].
    pub matrix: Small,
    /// c, a column of d.
    pub linear: Small,
    /// b.
    pub constant: f64,
}

impl StateCost {
    /// The cost of a state.
    pub fn at(&self, z: &[f64]) -> f64 {
        let z = Small::column(z);
        0.5 * self.matrix.quadratic(&z) + self.linear.inner(&z) + self.constant
    }
}

/// The pairs (i, j) with i <= j. The coordinate of a pair is the entry of C, times √2 off the diagonal, so that distances
/// are those of matrices.
fn pairs(d: usize) -> Vec<(usize, usize)> {
    (0..d).flat_map(|i| (i..d).map(move |j| (i, j))).collect()
}

fn coordinates(matrix: &Small) -> Vec<f64> {
    pairs(matrix.rows())
        .iter()
        .map(|&(i, j)| matrix.at(i, j) * if i == j { 1.0 } else { std::f64::consts::SQRT_2 })
        .collect()
}

fn matrix_of(d: usize, coordinates: &[f64]) -> Small {
    let mut matrix = Small::zeros(d, d);
    for (&(i, j), &x) in pairs(d).iter().zip(coordinates) {
        let entry = if i == j { x } else { x / std::f64::consts::SQRT_2 };
        (*matrix.at_mut(i, j), *matrix.at_mut(j, i)) = (entry, entry);
    }
    matrix
}

/// States with their mean and a root of their covariance: z = mean + root u with u of mean 0 and covariance I.
struct Whitened {
    mean: Small,
    root: Small,
    states: Vec<Small>,
}

impl Whitened {
    fn new(d: usize, states: &[f64]) -> Option<Self> {
        let count = (states.len() / d) as f64;
        let columns: Vec<Small> = states.chunks_exact(d).map(Small::column).collect();
        let mean = columns.iter().fold(Small::zeros(d, 1), |sum, z| sum.plus(1.0 / count, z));
        let mut covariance = Small::zeros(d, d);
        for z in &columns {
            let rest = z.plus(-1.0, &mean);
            covariance = covariance.plus(1.0 / count, &rest.times_transposed(&rest));
        }
        let ridge = RIDGE * (covariance.trace() / d as f64) + f64::MIN_POSITIVE;
        let root = covariance.plus(ridge, &Small::diagonal(d, 1.0)).cholesky()?;
        let inverse = root.inverse_of_lower();
        let states = columns.iter().map(|z| inverse.times(&z.plus(-1.0, &mean))).collect();
        Some(Self { mean, root, states })
    }

    /// A cost of u as a cost of z.
    fn cost_of_states(&self, cost: &StateCost) -> StateCost {
        let inverse = self.root.inverse_of_lower();
        let matrix = inverse.transposed_times(&cost.matrix.times(&inverse)).symmetric();
        let slope = inverse.transposed_times(&cost.linear);
        let linear = slope.plus(-1.0, &matrix.times(&self.mean));
        let constant = cost.constant + 0.5 * matrix.quadratic(&self.mean) - slope.inner(&self.mean);
        StateCost { matrix, linear, constant }
    }
}

/// Fits the cost to `costs` at `states`, d numbers each; `None` if numbers are not finite. Where `is_convex` is not set, C is
/// only symmetric.
pub fn fit(d: usize, states: &[f64], costs: &[f64], is_convex: bool) -> Option<StateCost> {
    let whitened = Whitened::new(d, states)?;
    let rows: Vec<Vec<f64>> = whitened
        .states
        .iter()
        .map(|u| {
            let products = coordinates(&u.times_transposed(u)).into_iter().map(|x| 0.5 * x);
            products.chain(u.iter()).chain([1.0]).collect()
        })
        .collect();
    let (width, free) = (rows.first()?.len(), d * (d + 1) / 2);
    let normal = Normal::new(&rows, costs, width);
    let mut solution = normal.solve(&[], 0.0)?;
    if is_convex && !is_positive_semidefinite(&matrix_of(d, &solution[..free])) {
        solution = admm(d, free, &normal)?;
    }
    let cost = StateCost {
        matrix: matrix_of(d, &solution[..free]),
        linear: Small::column(&solution[free..free + d]),
        constant: solution[free + d],
    };
    Some(whitened.cost_of_states(&cost))
}

fn is_positive_semidefinite(matrix: &Small) -> bool {
    super::eigen::eigen(matrix).0.iter().all(|&value| value >= 0.0)
}

/// Minimises the squares over C >= 0: x is free, z is positive semidefinite, and w holds what they differ by.
fn admm(d: usize, free: usize, normal: &Normal) -> Option<Vec<f64>> {
    let rho = normal.stiffness(free);
    let factor = normal.factor(free, rho)?;
    let (mut z, mut w) = (vec![0.0; free], vec![0.0; free]);
    let norm = |x: &[f64]| x.iter().map(|x| x * x).sum::<f64>().sqrt();
    for _ in 0..MOST_STEPS {
        let wanted: Vec<f64> = z.iter().zip(&w).map(|(z, w)| z - w).collect();
        let x = factor.solve(&normal.right(&wanted, rho));
        let lifted: Vec<f64> = x.iter().zip(&w).map(|(x, w)| x + w).collect();
        let next = coordinates(&positive_part(&matrix_of(d, &lifted)));
        let moved: Vec<f64> = next.iter().zip(&z).map(|(next, z)| next - z).collect();
        let apart: Vec<f64> = x.iter().zip(&next).map(|(x, z)| x - z).collect();
        w.iter_mut().zip(&apart).for_each(|(w, apart)| *w += apart);
        z = next;
        let size = norm(&z) + norm(&w);
        if !size.is_finite() {
            return None;
        }
        if norm(&moved) + norm(&apart) <= TOLERANCE * size {
            break;
        }
    }
    // C is exactly positive semidefinite; c and b are the best for it.
    normal.rest_given(&z)
}

/// The normal equations of the squares: H x = g.
struct Normal {
    h: Vec<Vec<f64>>,
    g: Vec<f64>,
}

/// A Cholesky factor of any size.
struct Factor(Vec<Vec<f64>>);

impl Factor {
    fn of(matrix: &[Vec<f64>]) -> Option<Self> {
        let n = matrix.len();
        let mut root = vec![vec![0.0; n]; n];
        for i in 0..n {
            for j in 0..=i {
                let known: f64 = (0..j).map(|k| root[i][k] * root[j][k]).sum();
                let rest = matrix[i][j] - known;
                root[i][j] = if i > j { rest / root[j][j] } else { rest.max(f64::MIN_POSITIVE).sqrt() };
                if !root[i][j].is_finite() {
                    return None;
                }
            }
        }
        Some(Self(root))
    }

    fn solve(&self, right: &[f64]) -> Vec<f64> {
        let (root, n) = (&self.0, right.len());
        let mut x = right.to_vec();
        for i in 0..n {
            let known: f64 = (0..i).map(|k| root[i][k] * x[k]).sum();
            x[i] = (x[i] - known) / root[i][i];
        }
        for i in (0..n).rev() {
            let known: f64 = (i + 1..n).map(|k| root[k][i] * x[k]).sum();
            x[i] = (x[i] - known) / root[i][i];
        }
        x
    }
}

impl Normal {
    fn new(rows: &[Vec<f64>], costs: &[f64], width: usize) -> Self {
        let (mut h, mut g) = (vec![vec![0.0; width]; width], vec![0.0; width]);
        let share = 1.0 / rows.len() as f64;
        for (row, cost) in rows.iter().zip(costs) {
            for i in 0..width {
                g[i] += share * row[i] * cost;
                for j in 0..width {
                    h[i][j] += share * row[i] * row[j];
                }
            }
        }
        Self { h, g }
    }

    /// The mean of H's diagonal over the entries of C.
    fn stiffness(&self, free: usize) -> f64 {
        (0..free).map(|i| self.h[i][i]).sum::<f64>() / free as f64
    }

    /// The factor of H + rho I over the first `free` coordinates.
    fn factor(&self, free: usize, rho: f64) -> Option<Factor> {
        let mut h = self.h.clone();
        (0..free).for_each(|i| h[i][i] += rho);
        Factor::of(&h)
    }

    /// g, plus rho times what the first coordinates should be.
    fn right(&self, wanted: &[f64], rho: f64) -> Vec<f64> {
        let mut right = self.g.clone();
        right.iter_mut().zip(wanted).for_each(|(right, wanted)| *right += rho * wanted);
        right
    }

    fn solve(&self, wanted: &[f64], rho: f64) -> Option<Vec<f64>> {
        Some(self.factor(wanted.len(), rho)?.solve(&self.right(wanted, rho)))
    }

    /// The solution whose first coordinates are given.
    fn rest_given(&self, first: &[f64]) -> Option<Vec<f64>> {
        let free = first.len();
        let matrix: Vec<Vec<f64>> = self.h[free..].iter().map(|row| row[free..].to_vec()).collect();
        let right: Vec<f64> = (free..self.g.len())
            .map(|i| self.g[i] - first.iter().enumerate().map(|(k, x)| self.h[i][k] * x).sum::<f64>())
            .collect();
        let rest = Factor::of(&matrix)?.solve(&right);
        Some(first.iter().copied().chain(rest).collect())
    }
}
