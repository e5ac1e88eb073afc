//! The forward and backward pass of the chain.

use super::{Chain, Evidence, EvidenceGradient};
use crate::{
    num::simd::vectorize,
    solar::{
        MOST_ACTION, Small,
        mniw::{Expected, Natural},
        square::{
            Square, Vector, apply, apply_transposed, dot, plus, root_of_inverse, sum, symmetric, times, transposed,
        },
    },
};

/// E t of the dynamics of one transition, split into the parts of z and of the action.
#[derive(Debug, Clone, Copy)]
pub(super) struct Dynamics<const D: usize> {
    w: Square<D>,
    pub(super) u: Square<D>,
    g: Square<D>,
    u_a: [[f64; MOST_ACTION]; D],
    g_a: [[f64; MOST_ACTION]; D],
    g_aa: [[f64; MOST_ACTION]; MOST_ACTION],
    e4: f64,
}

impl<const D: usize> Dynamics<D> {
    fn of(expected: &Expected, m: usize) -> Self {
        let Expected { e1, e2, e3, e4 } = expected;
        let action = |of: &dyn Fn(usize) -> f64| std::array::from_fn(|k| if k < m { of(D + k) } else { 0.0 });
        let square = |of: &dyn Fn(usize, usize) -> f64| std::array::from_fn(|i| std::array::from_fn(|j| of(i, j)));
        Self {
            w: square(&|i, j| -2.0 * e1.at(i, j)),
            u: square(&|i, j| e2.at(i, j)),
            g: square(&|i, j| -2.0 * e3.at(i, j)),
            u_a: std::array::from_fn(|i| action(&|k| e2.at(i, k))),
            g_a: std::array::from_fn(|i| action(&|k| -2.0 * e3.at(i, k))),
            g_aa: std::array::from_fn(|l| if l < m { action(&|k| -2.0 * e3.at(D + l, k)) } else { [0.0; MOST_ACTION] }),
            e4: *e4,
        }
    }

    /// U_a a, G_za a and the part of the constant that depends on the action a.
    #[inline(always)]
    fn drive(&self, a: &[f64; MOST_ACTION]) -> (Vector<D>, Vector<D>, f64) {
        let times = |row: &[f64; MOST_ACTION]| (0..MOST_ACTION).map(|k| row[k] * a[k]).sum::<f64>();
        let quadratic: f64 = (0..MOST_ACTION).map(|l| a[l] * times(&self.g_aa[l])).sum();
        (std::array::from_fn(|i| times(&self.u_a[i])), std::array::from_fn(|i| times(&self.g_a[i])), -0.5 * quadratic)
    }
}

/// What the forward pass leaves of a step, where z_t is eliminated: p(z_t | z_t+1, …) has covariance Q⁻¹.
#[derive(Debug, Clone, Copy)]
pub(super) struct Step<const D: usize> {
    /// The lower Cholesky factor of Q⁻¹.
    pub(super) root: Square<D>,
    /// Q⁻¹.
    pub(super) inverse: Square<D>,
    /// Q⁻¹ q.
    pub(super) centre: Vector<D>,
    /// L = Q⁻¹ U_zᵀ; zero at the last step.
    pub(super) gain: Square<D>,
}

/// Buffers for one trajectory.
#[derive(Debug)]
pub(super) struct Steps<const D: usize> {
    m: usize,
    pub(super) dynamics: Vec<Dynamics<D>>,
    pub(super) steps: Vec<Step<D>>,
    pub(super) precision: Vec<Vector<D>>,
    pub(super) linear: Vec<Vector<D>>,
    pub(super) means: Vec<Vector<D>>,
    pub(super) covariances: Vec<Square<D>>,
    pub(super) cross: Vec<Square<D>>,
    log_normalizer: f64,
    pub(super) noise: Vec<Vector<D>>,
    pub(super) samples: Vec<Vector<D>>,
    /// The gradients with respect to the samples, and Q⁻¹ times them.
    pub(super) d_samples: Vec<[Vector<D>; 2]>,
    /// The derivatives of Q and q in the direction (J, h).
    pub(super) tangents: Vec<(Square<D>, Vector<D>)>,
}

/// Copies d numbers a step.
pub(super) fn copy<const D: usize>(steps: &mut Vec<Vector<D>>, numbers: &[f64]) {
    let (vectors, rest) = numbers.as_chunks::<D>();
    assert!(rest.is_empty(), "{D} numbers for every step");
    steps.clear();
    steps.extend_from_slice(vectors);
}

impl<const D: usize> Steps<D> {
    pub(super) fn new(m: usize, steps: usize) -> Self {
        Self {
            m,
            dynamics: Vec::with_capacity(steps),
            steps: Vec::with_capacity(steps),
            precision: Vec::with_capacity(steps),
            linear: Vec::with_capacity(steps),
            means: Vec::with_capacity(steps),
            covariances: Vec::with_capacity(steps),
            cross: Vec::with_capacity(steps),
            log_normalizer: 0.0,
            noise: Vec::with_capacity(steps),
            samples: Vec::with_capacity(steps),
            d_samples: Vec::with_capacity(steps),
            tangents: Vec::with_capacity(steps),
        }
    }

    /// The dynamics of transition t -> t+1.
    #[inline(always)]
    pub(super) fn transition(&self, t: usize) -> &Dynamics<D> {
        if self.dynamics.len() == 1 { &self.dynamics[0] } else { &self.dynamics[t] }
    }

    /// Filters forwards and eliminates one latent state after the other.
    #[inline(always)]
    fn forward(&mut self, actions: &[f64]) {
        let last = self.precision.len() - 1;
        self.steps.clear();
        // The precision and the linear term of z_t given what came before it.
        let mut predicted: Square<D> = std::array::from_fn(|i| std::array::from_fn(|j| f64::from(i == j)));
        let mut linear = [0.0; D];
        let mut log_normalizer = 0.0;
        for t in 0..=last {
            let mut q_matrix = predicted;
            for i in 0..D {
                q_matrix[i][i] += self.precision[t][i];
            }
            let mut q = sum(&linear, &self.linear[t]);
            if t == last {
                let (root, log_determinant) = root_of_inverse(&q_matrix);
                let inverse = times(&root, &transposed(&root));
                let centre = apply(&inverse, &q);
                log_normalizer += 0.5 * (dot(&q, &centre) - log_determinant);
                self.steps.push(Step { root, inverse, centre, gain: [[0.0; D]; D] });
                break;
            }
            let dynamics = *self.transition(t);
            let mut action = [0.0; MOST_ACTION];
            action[..self.m].copy_from_slice(&actions[t * self.m..][..self.m]);
            let (push, pull, constant) = dynamics.drive(&action);
            q_matrix = plus(&q_matrix, 1.0, &dynamics.g);
            for i in 0..D {
                q[i] -= pull[i];
            }
            let (root, log_determinant) = root_of_inverse(&q_matrix);
            let inverse = times(&root, &transposed(&root));
            let centre = apply(&inverse, &q);
            log_normalizer += dynamics.e4 + constant + 0.5 * (dot(&q, &centre) - log_determinant);
            let gain = times(&inverse, &transposed(&dynamics.u));
            predicted = symmetric(&plus(&dynamics.w, -1.0, &times(&dynamics.u, &gain)));
            linear = sum(&push, &apply_transposed(&gain, &q));
            self.steps.push(Step { root, inverse, centre, gain });
        }
        self.log_normalizer = log_normalizer;
    }

    /// Means and covariances of q, from the last step to the first.
    #[inline(always)]
    fn backward(&mut self) {
        let count = self.steps.len();
        self.means.resize(count, [0.0; D]);
        self.covariances.resize(count, [[0.0; D]; D]);
        self.cross.resize(count - 1, [[0.0; D]; D]);
        self.means[count - 1] = self.steps[count - 1].centre;
        self.covariances[count - 1] = self.steps[count - 1].inverse;
        for t in (0..count - 1).rev() {
            let Step { inverse, centre, gain, .. } = &self.steps[t];
            self.means[t] = sum(centre, &apply(gain, &self.means[t + 1]));
            let cross = times(gain, &self.covariances[t + 1]);
            self.covariances[t] = symmetric(&plus(inverse, 1.0, &times(&cross, &transposed(gain))));
            self.cross[t] = transposed(&cross);
        }
    }
}

impl<const D: usize> Chain for Steps<D> {
    fn set_dynamics(&mut self, dynamics: &[Expected]) {
        let m = self.m;
        self.dynamics.clear();
        self.dynamics.extend(dynamics.iter().map(|expected| Dynamics::of(expected, m)));
    }

    fn smooth(&mut self, evidence: Evidence<'_>, actions: &[f64]) -> f64 {
        copy(&mut self.precision, evidence.precision);
        copy(&mut self.linear, evidence.linear);
        let (count, transitions) = (self.precision.len(), self.dynamics.len());
        assert!(count > 0 && self.linear.len() == count && actions.len() == count * self.m, "steps of a trajectory");
        assert!(transitions == 1 || transitions + 1 == count, "{transitions} transitions for {count} steps");
        vectorize(
            #[inline(always)]
            || {
                self.forward(actions);
                self.backward();
            },
        );
        self.log_normalizer
    }

    fn means(&self) -> &[f64] {
        self.means.as_flattened()
    }

    fn covariances(&self) -> &[f64] {
        self.covariances.as_flattened().as_flattened()
    }

    fn cross_covariances(&self) -> &[f64] {
        self.cross.as_flattened().as_flattened()
    }

    fn kl(&self) -> f64 {
        let mut sum = -self.log_normalizer;
        for t in 0..self.means.len() {
            let (mean, covariance) = (&self.means[t], &self.covariances[t]);
            for i in 0..D {
                let second = covariance[i][i] + mean[i] * mean[i];
                sum += self.linear[t][i] * mean[i] - 0.5 * self.precision[t][i] * second;
            }
        }
        sum
    }

    fn kl_gradient(&mut self, weight: f64, gradient: EvidenceGradient<'_>) {
        vectorize(
            #[inline(always)]
            || self.tangent(weight, gradient),
        );
    }

    fn sample(&mut self, noise: &[f64]) -> &[f64] {
        copy(&mut self.noise, noise);
        let count = self.steps.len();
        assert_eq!(self.noise.len(), count, "noise for every step");
        self.samples.resize(count, [0.0; D]);
        vectorize(
            #[inline(always)]
            || {
                let mut next = [0.0; D];
                for t in (0..count).rev() {
                    let Step { root, centre, gain, .. } = &self.steps[t];
                    next = sum(&sum(centre, &apply(gain, &next)), &apply(root, &self.noise[t]));
                    self.samples[t] = next;
                }
            },
        );
        self.samples.as_flattened()
    }

    fn sample_gradient(&mut self, d_sample: &[f64], gradient: EvidenceGradient<'_>) {
        vectorize(
            #[inline(always)]
            || self.reverse(d_sample, gradient),
        );
    }

    fn add_statistics(&self, actions: &[f64], strength: f64, action_variance: f64, statistics: &mut [Natural]) {
        for t in 0..self.cross.len() {
            let at = if statistics.len() == 1 { 0 } else { t };
            statistics[at] = statistics[at].plus(strength, &self.statistics(t, actions, action_variance));
        }
    }
}

impl<const D: usize> Steps<D> {
    /// E of z⁺z⁺ᵀ, z⁺yᵀ, yyᵀ and 1 for transition t.
    fn statistics(&self, t: usize, actions: &[f64], action_variance: f64) -> Natural {
        let (p, a) = (D + self.m, &actions[t * self.m..][..self.m]);
        let y = |j: usize| if j < D { self.means[t][j] } else { a[j - D] };
        let (next, covariance, cross) = (&self.means[t + 1], &self.covariances[t], &self.cross[t]);
        let noise = |i: usize, j: usize| match (i < D, j < D) {
            (true, true) => covariance[i][j],
            (false, false) if i == j => action_variance,
            _ => 0.0,
        };
        Natural {
            n1: Small::from_fn(D, D, |i, j| self.covariances[t + 1][i][j] + next[i] * next[j]),
            n2: Small::from_fn(D, p, |i, j| if j < D { cross[i][j] } else { 0.0 } + next[i] * y(j)),
            n3: Small::from_fn(p, p, |i, j| noise(i, j) + y(i) * y(j)),
            n4: 1.0,
        }
    }
}
