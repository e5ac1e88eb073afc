//! LQR-FLM: the policy of least cost within a KL divergence from the old policy (Levine and Abbeel, 2014),
//! and the adaptation of that bound.

use super::{
    Small,
    lqr::{LinearSystem, Marginal, Quadratic, marginals, solve},
    policy::{LinearGaussianPolicy, PolicyStep},
};

/// Bounds of the multiplier eta.
const ETA: (f64, f64) = (1e-8, 1e16);
/// The search ends within this share of the bound.
const TOLERANCE: f64 = 0.1;
/// The search ends where eta changes by less.
const LEAST_CHANGE: f64 = 1e-6;
/// The most policies that the search tries.
const MOST_TRIALS: usize = 50;
/// eta grows by this much, and then twice as much each time, until the surrogate has a least cost.
const RAISE: f64 = 1e-4;

/// A policy of the search.
#[derive(Debug, Clone, PartialEq)]
pub struct Improved {
    /// The policy.
    pub policy: LinearGaussianPolicy,
    /// The multiplier at which the surrogate has a least cost, eta or a larger one.
    pub eta: f64,
    /// KL(new || old), summed over all steps, under the new policy's distribution.
    pub kl: f64,
    /// The distribution that it leads to.
    pub marginals: Vec<Marginal>,
}

/// The cost C/eta plus -ln of the old policy's density, without its constant.
fn surrogate(cost: &Quadratic, old: &PolicyStep, precision: &Small, eta: f64) -> Quadratic {
    let (m, d) = (old.gain.rows(), old.gain.columns());
    // [-K 1], by which y gives a - K z.
    let rest = Small::from_fn(m, d + m, |i, j| if j < d { -old.gain.at(i, j) } else { f64::from(i == j - d) });
    let weighted = precision.times(&rest);
    Quadratic {
        matrix: cost.matrix.scaled(1.0 / eta).plus(1.0, &rest.transposed_times(&weighted)),
        linear: cost.linear.scaled(1.0 / eta).plus(-1.0, &weighted.transposed_times(&old.offset)),
        constant: cost.constant / eta,
    }
}

/// KL(new || old) of every step under the marginals of the new policy; none below 0.
pub fn kl_of_steps(new: &LinearGaussianPolicy, old: &LinearGaussianPolicy, marginals: &[Marginal]) -> Option<Vec<f64>> {
    let of = |((new, old), marginal): ((&PolicyStep, &PolicyStep), &Marginal)| {
        let (m, d) = (new.gain.rows(), new.gain.columns());
        let (precision, log_old) = old.covariance.inverse()?;
        let (_, log_new) = new.covariance.inverse()?;
        let (gain, offset) = (new.gain.plus(-1.0, &old.gain), new.offset.plus(-1.0, &old.offset));
        let mean = gain.times(&marginal.mean.block(0..d, 0..1)).plus(1.0, &offset);
        let spread = gain.times(&marginal.covariance.block(0..d, 0..d)).times_transposed(&gain);
        let change = precision.inner(&new.covariance) - m as f64 + log_old - log_new;
        Some((0.5 * (change + precision.quadratic(&mean) + precision.inner(&spread))).max(0.0))
    };
    new.steps.iter().zip(&old.steps).zip(marginals).map(of).collect()
}

/// The policy that minimises the surrogate for a multiplier eta, which is raised until there is one; `None` if no eta
/// gives one, or if the old policy has no density. `tried` gets every eta.
pub fn at_multiplier(
    system: &LinearSystem,
    costs: &[Quadratic],
    old: &LinearGaussianPolicy,
    eta: f64,
    tried: &mut Vec<f64>,
) -> Option<Improved> {
    let precisions: Vec<Small> =
        old.steps.iter().map(|step| Some(step.covariance.inverse()?.0)).collect::<Option<_>>()?;
    let (first, mut raise, mut eta) = (eta, RAISE, eta);
    while eta <= ETA.1 {
        tried.push(eta);
        let steps = costs.iter().zip(&old.steps).zip(&precisions);
        let surrogates: Vec<_> = steps.map(|((cost, old), precision)| surrogate(cost, old, precision, eta)).collect();
        if let Some(solution) = solve(system, &surrogates) {
            let marginals = marginals(system, &solution.policy);
            let kl = kl_of_steps(&solution.policy, old, &marginals)?.iter().sum();
            return Some(Improved { policy: solution.policy, eta, kl, marginals });
        }
        eta = first + raise;
        raise *= 2.0;
    }
    None
}

/// The policy whose KL divergence from the old policy is about `bound`, by a bracket search from eta = 1; `None` if there
/// is none. `trials` gets eta and KL of every policy that was tried.
pub fn improve(
    system: &LinearSystem,
    costs: &[Quadratic],
    old: &LinearGaussianPolicy,
    bound: f64,
    trials: &mut Vec<(f64, f64)>,
) -> Option<Improved> {
    let (mut low, mut high) = ETA;
    let mut eta = 1.0;
    loop {
        let improved = at_multiplier(system, costs, old, eta, &mut Vec::new())?;
        let (eta_now, kl) = (improved.eta, improved.kl);
        trials.push((eta_now, kl));
        let next = if kl < bound {
            high = eta_now;
            (low * high).sqrt().max(0.1 * high)
        } else {
            low = eta_now;
            (low * high).sqrt().min(10.0 * low)
        };
        let is_within = (kl - bound).abs() < TOLERANCE * bound;
        if is_within || (next - eta_now).abs() < LEAST_CHANGE || trials.len() >= MOST_TRIALS || !kl.is_finite() {
            return Some(improved).filter(|improved| improved.kl.is_finite());
        }
        eta = next;
    }
}

/// The factor on the KL bound after an iteration, from the improvement of the cost that the models before it predicted and
/// the one that came.
pub fn adjustment(predicted: f64, actual: f64) -> f64 {
    (predicted / (2.0 * (predicted - actual).max(1e-4))).clamp(0.1, 5.0)
}

/// The multiplier of the KL bound, after its adjustment.
pub fn adjusted(multiplier: f64, predicted: f64, actual: f64) -> f64 {
    (adjustment(predicted, actual) * multiplier).clamp(0.1, 10.0)
}
