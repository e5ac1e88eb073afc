//! iLQR, the controller of PCC (receding horizon): at every step of an episode it plans with the mean dynamics of a
//! model and applies the first action of its best plan.
//!
//! iLQR learns nothing. It starts from several random plans and improves each by Riccati's recursion on a linearisation
//! of the dynamics. All numbers are in double precision.

mod dynamics;
mod policy;
#[cfg(test)]
mod tests;

use crate::num::{linalg::Matrix, rng::Rng, sampling};

pub use dynamics::{Dynamics, Jacobians, LatentDynamics};
pub use policy::IlqrPolicy;

/// Regularisation of Q_uu at first, and again after every improvement.
const FIRST_MU: f64 = 1e-5;
/// Step lengths that the line search tries: 1, 1/2, 1/4, ….
const LINE_SEARCH: usize = 14;

/// The most sweeps over the components of an action.
const SWEEPS: usize = 100;

/// Constants of iLQR. The cost of a plan is Σ q |z_t - z_g|² + Σ r |u_t|².
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Ilqr {
    /// Cost of one squared unit of latent distance from the goal, q.
    pub state_cost: f64,
    /// Cost of one squared unit of action, r. An action's limit is 1.
    pub action_cost: f64,
    /// Steps of a plan. A plan never outlasts the episode.
    pub plan_length: u64,
    /// Plans that start from uniformly random actions.
    pub uniform_plans: u64,
    /// Plans that start from random actions at their limits.
    pub bang_bang_plans: u64,
    /// Attempts to improve every plan at every step of an episode.
    pub iterations: u64,
    /// Whether plans keep actions within their limits. Without it, a plan may count on actions that the task cuts, and on
    /// what F says of actions that no data show.
    pub control_limited: bool,
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
            control_limited: false,
        }
    }
}

/// Planned actions, and the codes that they lead through.
#[derive(Debug, Clone, PartialEq)]
struct Plan {
    /// One action a step.
    u: Vec<f64>,
    /// The first code, then one code a step.
    z: Vec<f64>,
    cost: f64,
}

/// The plan that the last step applied.
#[derive(Debug, Clone, PartialEq)]
struct Applied {
    /// Its number among the plans.
    which: usize,
    /// Its actions, the applied one included.
    u: Vec<f64>,
}

/// The result of Riccati's recursion for one step, k and K: the improved action is u + alpha k + K (z_new - z).
#[derive(Debug, Clone)]
struct Gains {
    feed_forward: Matrix,
    feedback: Matrix,
}

/// The k of least k' q_u + k' Q_uu k / 2, and K = -Q_uu⁻¹ Q_uz. With the action u of the plan, u + k stays within its limits,
/// and rows of K are zero where u + k is at a limit (Tassa et al., 2014). None where Q_uu is not positive definite.
fn best_step([q_u, q_uz, q_uu]: [&Matrix; 3], within: Option<&[f64]>) -> Option<Gains> {
    let root = q_uu.cholesky()?;
    let Some(u) = within else {
        let [feed_forward, feedback] = [q_u, q_uz].map(|q| root.solve_from_root(q).negative());
        return Some(Gains { feed_forward, feedback });
    };
    let k = least_within(q_u, q_uu, u);
    let is_free = |i: usize| (u[i] + k[i]).abs() < 1.0;
    let free = |i: usize, j: usize| if is_free(i) && is_free(j) { q_uu.of(i, j) } else { f64::from(i == j) };
    let q_free = Matrix::from_fn(u.len(), u.len(), free);
    let slope = Matrix::from_fn(u.len(), q_uz.columns(), |i, j| if is_free(i) { q_uz.of(i, j) } else { 0.0 });
    let feedback = q_free.cholesky()?.solve_from_root(&slope).negative();
    Some(Gains { feed_forward: Matrix::column(k), feedback })
}

/// The k of least k' q + k' Q k / 2 with every |u + k| at most 1, by descent along one component after the other.
fn least_within(q: &Matrix, bend: &Matrix, u: &[f64]) -> Vec<f64> {
    let mut k = vec![0.0; u.len()];
    for _ in 0..SWEEPS {
        let mut change = 0.0_f64;
        for i in 0..k.len() {
            let slope = q.of(i, 0) + (0..k.len()).map(|j| bend.of(i, j) * k[j]).sum::<f64>();
            let new = (k[i] - slope / bend.of(i, i)).clamp(-1.0 - u[i], 1.0 - u[i]);
            change = change.max((new - k[i]).abs());
            k[i] = new;
        }
        if change < 1e-12 {
            break;
        }
    }
    k
}

/// Plans towards one goal over the steps of an episode.
#[derive(Debug)]
pub struct Planner<'a, D> {
    settings: &'a Ilqr,
    dynamics: D,
    z_goal: Vec<f64>,
    rng: Rng,
    applied: Option<Applied>,
}

impl<'a, D: Dynamics> Planner<'a, D> {
    /// A planner without plans. It draws first plans from `rng`.
    pub fn new(settings: &'a Ilqr, dynamics: D, z_goal: Vec<f64>, rng: Rng) -> Self {
        Self { settings, dynamics, z_goal, rng, applied: None }
    }

    /// The action at `z`, where `left` actions remain, this one included. It may exceed the limits, unless plans keep within
    /// them.
    pub fn act(&mut self, z: &[f64], left: usize) -> Vec<f64> {
        let steps = left.min(self.settings.plan_length as usize);
        let mut best: Option<(usize, Plan)> = None;
        for which in 0..(self.settings.uniform_plans + self.settings.bang_bang_plans) as usize {
            let actions = self.first_actions(which, steps);
            let plan = self.improve(z, &actions);
            if best.as_ref().is_none_or(|(_, best)| plan.cost < best.cost) {
                best = Some((which, plan));
            }
        }
        let (which, plan) = best.expect("at least one plan");
        let action = plan.u[..self.dynamics.action()].to_vec();
        self.applied = Some(Applied { which, u: plan.u });
        action
    }

    /// The actions that a plan starts from: the applied plan is shifted by one step and its last action repeated, all
    /// other plans are drawn at random.
    fn first_actions(&mut self, which: usize, steps: usize) -> Vec<f64> {
        let a = self.dynamics.action();
        if let Some(Applied { u, .. }) = self.applied.take_if(|applied| applied.which == which) {
            let last = &u[u.len() - a..];
            return u[a..].iter().chain(last).copied().take(steps * a).collect();
        }
        let is_uniform = which < self.settings.uniform_plans as usize;
        let mut draw = || match is_uniform {
            true => f64::from(sampling::uniform(&mut self.rng, -1.0, 1.0)),
            false => [-1.0, 1.0][sampling::index(&mut self.rng, 2)],
        };
        (0..steps * a).map(|_| draw()).collect()
    }

    /// The plan that iLQR's iterations reach from these actions.
    fn improve(&mut self, z: &[f64], actions: &[f64]) -> Plan {
        let mut plan = self.follow(z, actions.len(), |t, _, u| u.copy_from_slice(&actions[t * u.len()..][..u.len()]));
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

    /// The plan that follows the mean dynamics from `z`. `choose` writes the action of a step, given the code there.
    fn follow(&mut self, z: &[f64], actions: usize, choose: impl Fn(usize, &[f64], &mut [f64])) -> Plan {
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

    /// Σ q |z_t - z_g|² + Σ r |u_t|²; infinite where a plan overflows.
    fn cost(&self, plan: &Plan) -> f64 {
        let apart = plan.z.chunks_exact(self.z_goal.len()).flat_map(|z| z.iter().zip(&self.z_goal));
        let far: f64 = apart.map(|(z, goal)| (z - goal) * (z - goal)).sum();
        let effort: f64 = plan.u.iter().map(|u| u * u).sum();
        let cost = self.settings.state_cost * far + self.settings.action_cost * effort;
        if cost.is_finite() { cost } else { f64::INFINITY }
    }

    /// A = ∂f/∂z and B = ∂f/∂u at every step of a plan.
    fn linearize(&mut self, plan: &Plan) -> Vec<Jacobians> {
        let (n, a) = (self.dynamics.latent(), self.dynamics.action());
        plan.z.chunks_exact(n).zip(plan.u.chunks_exact(a)).map(|(z, u)| self.dynamics.jacobians(z, u)).collect()
    }

    /// The backward pass. V is the cost to go at a step, Q the cost to go as a function of its action. None where a Q_uu
    /// is not positive definite.
    fn gains(&self, plan: &Plan, linear: &[Jacobians], mu: f64) -> Option<Vec<Gains>> {
        let (n, a) = (self.dynamics.latent(), self.dynamics.action());
        let (q, r) = (self.settings.state_cost, self.settings.action_cost);
        let slope_of = |t: usize| {
            let z = plan.z[t * n..][..n].iter();
            Matrix::column(z.zip(&self.z_goal).map(|(z, g)| 2.0 * q * (z - g)).collect())
        };
        let (mut v_z, mut v_zz) = (slope_of(linear.len()), Matrix::diagonal(n, 2.0 * q));
        let mut gains = Vec::with_capacity(linear.len());
        for (t, Jacobians { a: f_z, b: f_u }) in linear.iter().enumerate().rev() {
            let effort = Matrix::column(plan.u[t * a..][..a].iter().map(|u| 2.0 * r * u).collect());
            let ahead = v_zz.times(f_z);
            let q_z = slope_of(t).plus(&f_z.transposed_times(&v_z));
            let q_u = effort.plus(&f_u.transposed_times(&v_z));
            let q_zz = Matrix::diagonal(n, 2.0 * q).plus(&f_z.transposed_times(&ahead));
            let q_uz = f_u.transposed_times(&ahead);
            let q_uu = Matrix::diagonal(a, 2.0 * r + mu).plus(&f_u.transposed_times(&v_zz.times(f_u)));
            let limits = self.settings.control_limited.then_some(&plan.u[t * a..][..a]);
            let Gains { feed_forward, feedback } = best_step([&q_u, &q_uz, &q_uu], limits)?;
            v_z = q_z.plus(&q_uz.transposed_times(&feed_forward));
            v_zz = q_zz.plus(&q_uz.transposed_times(&feedback));
            gains.push(Gains { feed_forward, feedback });
        }
        gains.reverse();
        Some(gains)
    }

    /// The line search: the plan after the longest step along the gains that lowers the cost. A control-limited plan clips
    /// each action before it predicts the next code.
    fn search(&mut self, plan: &Plan, gains: &[Gains]) -> Option<Plan> {
        let (n, a) = (self.dynamics.latent(), self.dynamics.action());
        let limit = if self.settings.control_limited { 1.0 } else { f64::INFINITY };
        let mut alpha = 1.0;
        for _ in 0..LINE_SEARCH {
            let follow = |t: usize, z: &[f64], u: &mut [f64]| {
                let Gains { feed_forward, feedback } = &gains[t];
                let before = plan.z[t * n..][..n].iter();
                let change =
                    feedback.times(&Matrix::column(z.iter().zip(before).map(|(new, old)| new - old).collect()));
                for (i, u) in u.iter_mut().enumerate() {
                    let improved = plan.u[t * a + i] + alpha * feed_forward.of(i, 0) + change.of(i, 0);
                    *u = improved.clamp(-limit, limit);
                }
            };
            let candidate = self.follow(&plan.z[..n], plan.u.len(), follow);
            if candidate.cost < plan.cost {
                return Some(candidate);
            }
            alpha *= 0.5;
        }
        None
    }
}
