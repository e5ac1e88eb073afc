//! The local dynamics of an iteration: variational Bayes over the latest rollouts, with the global dynamics as the prior.

use super::{
    Small,
    chain::{Chain, Evidence},
    mniw::{Expected, Mniw, Natural},
};

/// Rollouts of equal length, as the encoder and the simulator gave them.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Rollouts {
    /// Steps of a rollout, T.
    pub steps: usize,
    /// Components of a latent state.
    pub d: usize,
    /// Components of an action.
    pub m: usize,
    /// The diagonals of the potentials' J, d numbers a step, rollout by rollout.
    pub precision: Vec<f64>,
    /// The potentials' h.
    pub linear: Vec<f64>,
    /// The actions that were executed, m numbers a step.
    pub actions: Vec<f64>,
}

impl Rollouts {
    /// How many there are.
    pub fn len(&self) -> usize {
        self.actions.len() / (self.steps * self.m)
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.actions.is_empty()
    }

    /// The potentials of a rollout.
    pub fn evidence(&self, rollout: usize) -> Evidence<'_> {
        let width = self.steps * self.d;
        let of = |numbers| -> &[f64] { &Vec::as_slice(numbers)[rollout * width..][..width] };
        Evidence { precision: of(&self.precision), linear: of(&self.linear) }
    }

    /// The actions of a rollout.
    pub fn actions_of(&self, rollout: usize) -> &[f64] {
        &self.actions[rollout * self.steps * self.m..][..self.steps * self.m]
    }
}

/// How local dynamics are fitted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LocalFit {
    /// The weight of a rollout in pseudo-counts.
    pub strength: f64,
    /// The variance that an action counts as having.
    pub action_variance: f64,
    /// The fit ends once the objective changes by less.
    pub tolerance: f64,
    /// The most sweeps.
    pub sweeps: u64,
}

/// The posterior over the dynamics of every transition.
#[derive(Debug, Clone, PartialEq)]
pub struct LocalDynamics {
    /// q(F_t, Σ_t).
    pub dynamics: Vec<Mniw>,
    /// E t of `dynamics`, by which the next rollouts are filtered.
    pub expected: Vec<Expected>,
    /// The objective before each sweep and after the last: strength Σ ln Z - Σ KL(q || prior). It never falls.
    pub objective: Vec<f64>,
    /// Smoothed means of all rollouts, d numbers a step.
    pub means: Vec<f64>,
}

/// Fits the local dynamics; `None` if numbers are not finite. `global` has one entry for every transition, or one for all.
pub fn fit(
    rollouts: &Rollouts,
    global: &[Natural],
    settings: LocalFit,
    chain: &mut dyn Chain,
) -> Option<LocalDynamics> {
    let transitions = rollouts.steps - 1;
    let prior: Vec<Natural> = (0..transitions).map(|t| global[if global.len() == 1 { 0 } else { t }]).collect();
    let prior_mniw: Vec<Mniw> = prior.iter().map(Natural::mniw).collect::<Option<_>>()?;
    let mut dynamics = prior_mniw.clone();
    let mut objective: Vec<f64> = Vec::new();
    loop {
        let expected: Vec<Expected> = dynamics.iter().map(Mniw::expected).collect::<Option<_>>()?;
        chain.set_dynamics(&expected);
        let mut next = vec![Natural::zero(rollouts.d, rollouts.d + rollouts.m); transitions];
        let (mut log_normalizer, mut means) = (0.0, Vec::with_capacity(rollouts.linear.len()));
        for rollout in 0..rollouts.len() {
            let actions = rollouts.actions_of(rollout);
            log_normalizer += chain.smooth(rollouts.evidence(rollout), actions);
            means.extend_from_slice(chain.means());
            chain.add_statistics(actions, settings.strength, settings.action_variance, &mut next);
        }
        let kls: Option<Vec<f64>> = dynamics.iter().zip(&prior_mniw).map(|(q, prior)| q.kl(prior)).collect();
        let now = settings.strength * log_normalizer - kls?.iter().sum::<f64>();
        let change = objective.last().map(|before| (now - before).abs());
        objective.push(now);
        if !now.is_finite() {
            return None;
        }
        if change.is_some_and(|change| change < settings.tolerance) || objective.len() as u64 > settings.sweeps {
            return Some(LocalDynamics { dynamics, expected, objective, means });
        }
        let posterior = next.iter().zip(&prior).map(|(statistics, prior)| prior.plus(1.0, statistics).mniw());
        dynamics = posterior.collect::<Option<_>>()?;
    }
}

impl LocalDynamics {
    /// Mean and diagonal covariance of the smoothed first states of `count` rollouts.
    pub fn start(&self, count: usize, d: usize) -> (Small, Small) {
        let width = self.means.len() / count;
        let first = |rollout: usize, i: usize| self.means[rollout * width + i];
        let mean_of = |of: &dyn Fn(usize) -> f64| (0..count).map(of).sum::<f64>() / count as f64;
        let mean = Small::from_fn(d, 1, |i, _| mean_of(&|rollout| first(rollout, i)));
        let variance = |i: usize| mean_of(&|rollout| (first(rollout, i) - mean.at(i, 0)).powi(2)).max(LEAST_VARIANCE);
        (mean, Small::from_fn(d, d, |i, j| if i == j { variance(i) } else { 0.0 }))
    }
}

/// The least variance of a component of the first state.
const LEAST_VARIANCE: f64 = 1e-6;
