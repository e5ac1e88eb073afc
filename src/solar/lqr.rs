//! The linear-quadratic regulator over a finite horizon: the optimal policy, the distribution that a policy leads to, and
//! its expected cost.

use super::{
    Small,
    policy::{LinearGaussianPolicy, PolicyStep},
};

/// One step of the dynamics, z' ~ N(D y + d, noise) with y = \[z; a\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Transition {
    /// D \[d, p\].
    pub matrix: Small,
    /// d, a column.
    pub offset: Small,
    /// The covariance of the noise \[d, d\].
    pub noise: Small,
}

/// Linear dynamics over T steps; the transition of the last step leads nowhere.
#[derive(Debug, Clone, PartialEq)]
pub struct LinearSystem {
    /// The transitions.
    pub transitions: Vec<Transition>,
    /// The mean of z_1.
    pub start_mean: Small,
    /// The covariance of z_1.
    pub start_covariance: Small,
}

/// The cost of a step, ½ yᵀCy + cᵀy + b.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quadratic {
    /// C \[p, p\].
    pub matrix: Small,
    /// c, a column.
    pub linear: Small,
    /// b.
    pub constant: f64,
}

/// The optimal policy and its value function ½ zᵀVz + vᵀz at every step.
#[derive(Debug, Clone, PartialEq)]
pub struct Solution {
    /// The policy, with covariance Q_aa⁻¹.
    pub policy: LinearGaussianPolicy,
    /// V, v of every step.
    pub values: Vec<(Small, Small)>,
}

/// The joint distribution of y at a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Marginal {
    /// The mean of \[z; a\].
    pub mean: Small,
    /// The covariance of \[z; a\].
    pub covariance: Small,
}

/// The policy of least cost; `None` if some Q_aa is not positive definite, so that no cost is least.
pub fn solve(system: &LinearSystem, costs: &[Quadratic]) -> Option<Solution> {
    let (d, p) = (system.start_mean.rows(), costs.first()?.linear.rows());
    let mut values: Vec<(Small, Small)> = Vec::with_capacity(costs.len());
    let mut steps = Vec::with_capacity(costs.len());
    for (cost, transition) in costs.iter().zip(&system.transitions).rev() {
        let (mut q_matrix, mut q) = (cost.matrix, cost.linear);
        if let Some((value_matrix, value)) = values.last() {
            let Transition { matrix, offset, .. } = transition;
            q_matrix = q_matrix.plus(1.0, &matrix.transposed_times(&value_matrix.times(matrix)));
            let slope = value.plus(1.0, &value_matrix.times(offset));
            q = q.plus(1.0, &matrix.transposed_times(&slope));
        }
        let q_matrix = q_matrix.symmetric();
        let (covariance, _) = q_matrix.block(d..p, d..p).inverse()?;
        let (q_za, q_a) = (q_matrix.block(0..d, d..p), q.block(d..p, 0..1));
        let gain = covariance.times_transposed(&q_za).scaled(-1.0);
        let offset = covariance.times(&q_a).scaled(-1.0);
        let value_matrix = q_matrix.block(0..d, 0..d).plus(1.0, &q_za.times(&gain)).symmetric();
        let value = q.block(0..d, 0..1).plus(1.0, &q_za.times(&offset));
        values.push((value_matrix, value));
        steps.push(PolicyStep { gain, offset, covariance });
    }
    values.reverse();
    steps.reverse();
    Some(Solution { policy: LinearGaussianPolicy { steps }, values })
}

/// The distribution of y at every step under a policy.
pub fn marginals(system: &LinearSystem, policy: &LinearGaussianPolicy) -> Vec<Marginal> {
    let d = system.start_mean.rows();
    let (mut z, mut covariance) = (system.start_mean, system.start_covariance);
    let mut all = Vec::with_capacity(policy.steps.len());
    for (PolicyStep { gain, offset, covariance: noise }, transition) in policy.steps.iter().zip(&system.transitions) {
        let p = d + offset.rows();
        let action = gain.times(&z).plus(1.0, offset);
        let from_state = gain.times(&covariance);
        let (mut mean, mut joint) = (Small::zeros(p, 1), Small::zeros(p, p));
        mean.set_block(0, 0, &z);
        mean.set_block(d, 0, &action);
        joint.set_block(0, 0, &covariance);
        joint.set_block(d, 0, &from_state);
        joint.set_block(0, d, &from_state.transposed());
        joint.set_block(d, d, &from_state.times_transposed(gain).plus(1.0, noise));
        all.push(Marginal { mean, covariance: joint });
        let Transition { matrix, offset, noise } = transition;
        z = matrix.times(&mean).plus(1.0, offset);
        covariance = matrix.times(&joint).times_transposed(matrix).plus(1.0, noise).symmetric();
    }
    all
}

/// The expected cost of all steps.
pub fn expected_cost(marginals: &[Marginal], costs: &[Quadratic]) -> f64 {
    let of = |(Marginal { mean, covariance }, cost): (&Marginal, &Quadratic)| {
        let Quadratic { matrix, linear, constant } = cost;
        0.5 * (matrix.inner(covariance) + matrix.quadratic(mean)) + linear.inner(mean) + constant
    };
    marginals.iter().zip(costs).map(of).sum()
}
