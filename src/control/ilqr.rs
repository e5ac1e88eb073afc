//! iLQR, the controller of PCC: it plans with the mean dynamics of a model, afresh at every step of an episode.
//!
//! Nothing is learned. A plan is improved from several random beginnings by Riccati's recursion on a linearisation of
//! the dynamics; its first action is applied. In double precision throughout.

mod dynamics;
mod matrix;
#[cfg(test)]
mod tests;

use self::matrix::Matrix;
use crate::num::{rng::Rng, sampling};

pub use dynamics::{Dynamics, LatentDynamics};

/// Regularisation of Q_uu to begin with, and after every improvement.
const FIRST_MU: f64 = 1e-5;
/// Lengths of step that the line search tries: 1, 1/2, 1/4, ….
const LINE_SEARCH: usize = 14;

/// How iLQR plans. The cost of a plan is Σ q |z_t - z_g|² + Σ r |u_t|².
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Ilqr {
    /// q, the cost of one squared unit of latent distance from the goal.
    pub state_cost: f64,
    /// r, the cost of one squared unit of action, where 1 is an action's limit.
    pub action_cost: f64,
    /// Steps of a plan; fewer where the episode ends before.
    pub plan_length: u64,
    /// Plans that begin as uniformly random actions.
    pub uniform_plans: u64,
    /// Plans that begin as random actions at their limits.
    pub bang_bang_plans: u64,
    /// Attempts to improve every plan, at every step of an episode.
    pub iterations: u64,
}

impl Default for Ilqr {
    fn default() -> Self {
        Self {
            state_cost: 10.0,
            action_cost: 1.0,
            plan_length: 10,
            uniform_plans: 3,
            bang_bang_plans: 3,
            iterations: 4,
        }
    }
}

/// Actions, one after the other, and the codes that they lead through, the first one included.
#[derive(Debug, Clone, PartialEq)]
struct Plan {
    u: Vec<f64>,
    z: Vec<f64>,
    cost: f64,
}

/// What Riccati's recursion gives for one step: u + alpha k + K (z_new - z).
#[derive(Debug, Clone)]
struct Gains {
    feed_forward: Matrix,
    feedback: Matrix,
}

/// Plans towards one goal, from step to step of an episode.
#[derive(Debug)]
pub struct Planner<'a, D> {
    settings: &'a Ilqr,
    dynamics: D,
    z_goal: Vec<f64>,
    rng: Rng,
    /// The last choice: which of the plans it was, and what is left of it.
    kept: Option<(usize, Vec<f64>)>,
}

impl<'a, D: Dynamics> Planner<'a, D> {
    /// No plans yet; their beginnings will be drawn from `rng`.
    pub fn new(settings: &'a Ilqr, dynamics: D, z_goal: Vec<f64>, rng: Rng) -> Self {
        Self { settings, dynamics, z_goal, rng, kept: None }
    }

    /// The action at `z` where `left` actions remain, this one included. It may lie beyond the limits: plans know none.
    pub fn act(&mut self, z: &[f64], left: usize) -> Vec<f64> {
        let steps = left.min(self.settings.plan_length as usize);
        let mut best: Option<(usize, Plan)> = None;
        for which in 0..(self.settings.uniform_plans + self.settings.bang_bang_plans) as usize {
            let actions = self.begin(which, steps);
            let plan = self.improve(z, &actions);
            if best.as_ref().is_none_or(|(_, best)| plan.cost < best.cost) {
                best = Some((which, plan));
            }
        }
        let (which, plan) = best.expect("at least one plan");
        let action = plan.u[..self.dynamics.action()].to_vec();
        self.kept = Some((which, plan.u));
        action
    }

    /// The last choice shifted by one step, its last action repeated; random actions for all other plans.
    fn begin(&mut self, which: usize, steps: usize) -> Vec<f64> {
        let a = self.dynamics.action();
        if let Some((_, chosen)) = self.kept.take_if(|(kept, _)| *kept == which) {
            let last = &chosen[chosen.len() - a..];
            return chosen[a..].iter().chain(last).copied().take(steps * a).collect();
        }
        let is_uniform = which < self.settings.uniform_plans as usize;
        let mut draw = || match is_uniform {
            true => f64::from(sampling::uniform(&mut self.rng, -1.0, 1.0)),
            false => [-1.0, 1.0][sampling::index(&mut self.rng, 2)],
        };
        (0..steps * a).map(|_| draw()).collect()
    }

    /// A plan from these actions, improved.
    fn improve(&mut self, z: &[f64], actions: &[f64]) -> Plan {
        let mut plan = self.roll_out(z, actions.len(), |t, _, u| u.copy_from_slice(&actions[t * u.len()..][..u.len()]));
        let mut linear = self.linearize(&plan);
        let mut mu = FIRST_MU;
        for attempt in 1..=self.settings.iterations {
            let better = self.gains(&plan, &linear, mu).and_then(|gains| self.search(&plan, &gains));
            let Some(better) = better else {
                mu *= 2.0;
                continue;
            };
            (plan, mu) = (better, FIRST_MU);
            if attempt < self.settings.iterations {
                linear = self.linearize(&plan);
            }
        }
        plan
    }

    /// Follows the mean dynamics from `z`; `choose` writes the action of a step for the code reached by then.
    fn roll_out(&mut self, z: &[f64], actions: usize, choose: impl Fn(usize, &[f64], &mut [f64])) -> Plan {
        let (n, a) = (self.dynamics.latent(), self.dynamics.action());
        let steps = actions / a;
        let mut plan = Plan { u: vec![0.0; actions], z: vec![0.0; (steps + 1) * n], cost: 0.0 };
        plan.z[..n].copy_from_slice(z);
        for t in 0..steps {
            let (before, after) = plan.z.split_at_mut((t + 1) * n);
            let (z, u) = (&before[t * n..], &mut plan.u[t * a..][..a]);
            choose(t, z, u);
            self.dynamics.next(z, u, &mut after[..n]);
        }
        plan.cost = self.cost(&plan);
        plan
    }

    /// Σ q |z_t - z_g|² + Σ r |u_t|²; infinite where a plan leaves the numbers.
    fn cost(&self, plan: &Plan) -> f64 {
        let apart = plan.z.chunks_exact(self.z_goal.len()).flat_map(|z| z.iter().zip(&self.z_goal));
        let far: f64 = apart.map(|(z, goal)| (z - goal) * (z - goal)).sum();
        let effort: f64 = plan.u.iter().map(|u| u * u).sum();
        let cost = self.settings.state_cost * far + self.settings.action_cost * effort;
        if cost.is_finite() { cost } else { f64::INFINITY }
    }

    /// A = ∂f/∂z and B = ∂f/∂u at every step of a plan.
    fn linearize(&mut self, plan: &Plan) -> Vec<(Matrix, Matrix)> {
        let (n, a) = (self.dynamics.latent(), self.dynamics.action());
        plan.z.chunks_exact(n).zip(plan.u.chunks_exact(a)).map(|(z, u)| self.dynamics.jacobians(z, u)).collect()
    }

    /// The backward pass: V is the cost to go from a step on, Q the same before its action is chosen. None where Q_uu
    /// has no minimum.
    fn gains(&self, plan: &Plan, linear: &[(Matrix, Matrix)], mu: f64) -> Option<Vec<Gains>> {
        let (n, a) = (self.dynamics.latent(), self.dynamics.action());
        let (q, r) = (self.settings.state_cost, self.settings.action_cost);
        let slope_of = |t: usize| {
            let z = plan.z[t * n..][..n].iter();
            Matrix::column(z.zip(&self.z_goal).map(|(z, g)| 2.0 * q * (z - g)).collect())
        };
        let (mut v_z, mut v_zz) = (slope_of(linear.len()), Matrix::diagonal(n, 2.0 * q));
        let mut gains = Vec::with_capacity(linear.len());
        for (t, (f_z, f_u)) in linear.iter().enumerate().rev() {
            let effort = Matrix::column(plan.u[t * a..][..a].iter().map(|u| 2.0 * r * u).collect());
            let ahead = v_zz.times(f_z);
            let q_z = slope_of(t).plus(&f_z.transposed_times(&v_z));
            let q_u = effort.plus(&f_u.transposed_times(&v_z));
            let q_zz = Matrix::diagonal(n, 2.0 * q).plus(&f_z.transposed_times(&ahead));
            let q_uz = f_u.transposed_times(&ahead);
            let q_uu = Matrix::diagonal(a, 2.0 * r + mu).plus(&f_u.transposed_times(&v_zz.times(f_u)));
            let root = q_uu.cholesky()?;
            let [feed_forward, feedback] = [&q_u, &q_uz].map(|q| root.solve_from_root(q).negative());
            v_z = q_z.plus(&q_uz.transposed_times(&feed_forward));
            v_zz = q_zz.plus(&q_uz.transposed_times(&feedback));
            gains.push(Gains { feed_forward, feedback });
        }
        gains.reverse();
        Some(gains)
    }

    /// The line search: the longest step along the gains after which a plan costs less.
    fn search(&mut self, plan: &Plan, gains: &[Gains]) -> Option<Plan> {
        let (n, a) = (self.dynamics.latent(), self.dynamics.action());
        let mut alpha = 1.0;
        for _ in 0..LINE_SEARCH {
            let follow = |t: usize, z: &[f64], u: &mut [f64]| {
                let Gains { feed_forward, feedback } = &gains[t];
                let before = plan.z[t * n..][..n].iter();
                let change =
                    feedback.times(&Matrix::column(z.iter().zip(before).map(|(new, old)| new - old).collect()));
                for (i, u) in u.iter_mut().enumerate() {
                    *u = plan.u[t * a + i] + alpha * feed_forward.of(i, 0) + change.of(i, 0);
                }
            };
            let candidate = self.roll_out(&plan.z[..n], plan.u.len(), follow);
            if candidate.cost < plan.cost {
                return Some(candidate);
            }
            alpha *= 0.5;
        }
        None
    }
}
