//! One iteration of control towards one goal: local dynamics, costs, the adaptation of the KL bound, and the trust-region
//! LQR.

use super::{
    LinearGaussianPolicy, Small,
    chain::Chain,
    cost_fit::{self, StateCost},
    local_dynamics::{LocalDynamics, LocalFit, Rollouts, fit},
    lqr::{LinearSystem, Quadratic, Transition, expected_cost, marginals},
    mniw::{Mniw, Natural},
    trust_region::{adjusted, improve},
};

/// What the controller knows of costs, beside ½ r |a|².
#[derive(Debug, Clone, Copy)]
pub enum Costs<'a> {
    /// The cost of a latent state is known.
    Known(&'a StateCost),
    /// The costs of all steps of the rollouts were observed, and a convex cost is fitted to them.
    Observed(&'a [f64]),
}

impl StateCost {
    /// κ |z - goal|².
    pub fn distance(kappa: f64, goal: &Small) -> Self {
        let d = goal.rows();
        Self {
            matrix: Small::diagonal(d, 2.0 * kappa),
            linear: goal.scaled(-2.0 * kappa),
            constant: kappa * goal.inner(goal),
        }
    }
}

/// The constants of an iteration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// How local dynamics are fitted.
    pub fit: LocalFit,
    /// KL bound of a step; the whole bound is this times T times the multiplier.
    pub kl_step: f64,
    /// r, the cost of actions.
    pub action_cost: f64,
}

/// A policy on its way, with what the next iteration must know of the last one.
#[derive(Debug, Clone, PartialEq)]
pub struct Progress {
    /// The policy.
    pub policy: LinearGaussianPolicy,
    /// The multiplier of the KL bound.
    pub multiplier: f64,
    /// The cost of the policy before, and of this one, under the models of the last iteration.
    pub estimates: Option<[f64; 2]>,
}

/// What an iteration did.
#[derive(Debug, Clone, PartialEq)]
pub struct Report {
    /// The objective of the local dynamics after the last sweep.
    pub objective: f64,
    /// Sweeps of the local fit.
    pub sweeps: usize,
    /// The multiplier eta of the trust region.
    pub eta: f64,
    /// KL over the bound.
    pub kl_share: f64,
    /// The improvement of the cost that this iteration predicts.
    pub predicted: f64,
    /// The improvement that the iteration before made, by the new models; `None` in the first iteration.
    pub actual: Option<f64>,
    /// The local dynamics.
    pub local: LocalDynamics,
}

impl Progress {
    /// A policy before its first iteration.
    pub fn new(policy: LinearGaussianPolicy) -> Self {
        Self { policy, multiplier: 1.0, estimates: None }
    }

    /// Improves the policy by its latest rollouts; `None` if numbers are not finite.
    pub fn improve(
        &mut self,
        rollouts: &Rollouts,
        global: &[Natural],
        costs: Costs<'_>,
        settings: &Settings,
        chain: &mut dyn Chain,
    ) -> Option<Report> {
        let local = fit(rollouts, global, settings.fit, chain)?;
        let system = system(&local, rollouts);
        let costs = quadratic(costs, &local, rollouts, settings.action_cost)?;
        let cost_of = |policy: &LinearGaussianPolicy| expected_cost(&marginals(&system, policy), &costs);
        let now = cost_of(&self.policy);
        let actual = self.estimates.map(|[before, expected]| {
            self.multiplier = adjusted(self.multiplier, before - expected, before - now);
            before - now
        });
        let bound = settings.kl_step * rollouts.steps as f64 * self.multiplier;
        let improved = improve(&system, &costs, &self.policy, bound, &mut Vec::new())?;
        let next = expected_cost(&improved.marginals, &costs);
        if !next.is_finite() {
            return None;
        }
        self.estimates = Some([now, next]);
        self.policy = improved.policy;
        Some(Report {
            objective: *local.objective.last()?,
            sweeps: local.objective.len() - 1,
            eta: improved.eta,
            kl_share: improved.kl / bound,
            predicted: now - next,
            actual,
            local,
        })
    }
}

/// The dynamics that the controller plans with: the means of F, and E Σ.
fn system(local: &LocalDynamics, rollouts: &Rollouts) -> LinearSystem {
    let transition =
        |q: &Mniw| Transition { matrix: q.m, offset: Small::zeros(rollouts.d, 1), noise: q.expected_sigma() };
    let mut transitions: Vec<Transition> = local.dynamics.iter().map(transition).collect();
    // The last step leads nowhere.
    transitions.extend(transitions.last().copied());
    let (start_mean, start_covariance) = local.start(rollouts.len(), rollouts.d);
    LinearSystem { transitions, start_mean, start_covariance }
}

/// The costs of all steps as functions of y.
fn quadratic(costs: Costs<'_>, local: &LocalDynamics, rollouts: &Rollouts, action_cost: f64) -> Option<Vec<Quadratic>> {
    let (d, m) = (rollouts.d, rollouts.m);
    let state = match costs {
        Costs::Known(state) => *state,
        Costs::Observed(observed) => {
            let of_action = |a: &[f64]| 0.5 * action_cost * a.iter().map(|a| a * a).sum::<f64>();
            let actions = rollouts.actions.chunks_exact(m);
            let of_states: Vec<f64> = observed.iter().zip(actions).map(|(cost, a)| cost - of_action(a)).collect();
            cost_fit::fit(d, &local.means, &of_states, true)?
        }
    };
    let (mut matrix, mut linear) = (Small::zeros(d + m, d + m), Small::zeros(d + m, 1));
    matrix.set_block(0, 0, &state.matrix);
    matrix.set_block(d, d, &Small::diagonal(m, action_cost));
    linear.set_block(0, 0, &state.linear);
    Some(vec![Quadratic { matrix, linear, constant: state.constant }; rollouts.steps])
}
