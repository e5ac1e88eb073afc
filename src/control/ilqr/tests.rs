//! Known answers on affine dynamics, where one plan is best and Riccati's recursion finds it; and what holds on any.

use rand::SeedableRng as _;

use super::*;

/// z' = A z + B u + c.
#[derive(Debug)]
struct Affine {
    a: Matrix,
    b: Matrix,
    c: Vec<f64>,
    action: usize,
}

impl Affine {
    /// A random one.
    fn random(latent: usize, action: usize, rng: &mut Rng) -> Self {
        let mut normal = |count: usize| {
            let mut samples = vec![0.0; count];
            sampling::fill_normal(rng, &mut samples);
            samples
        };
        // Far from unstable, or the plain values of the cost would not tell its minimum to many digits.
        let coupling = normal(latent * latent).into_iter().map(|entry| 0.2 * entry).collect();
        let a = Matrix::diagonal(latent, 0.8).plus(&Matrix::new(latent, coupling));
        Self { a, b: Matrix::new(action, normal(latent * action)), c: normal(latent), action }
    }
}

impl Dynamics for Affine {
    fn latent(&self) -> usize {
        self.c.len()
    }

    fn action(&self) -> usize {
        self.action
    }

    fn next(&mut self, z: &[f64], u: &[f64], next: &mut [f64]) {
        let vector = |entries: &[f64]| Matrix::column(entries.to_vec());
        let sum = self.a.times(&vector(z)).plus(&self.b.times(&vector(u))).plus(&vector(&self.c));
        for (i, next) in next.iter_mut().enumerate() {
            *next = sum.of(i, 0);
        }
    }

    fn jacobians(&mut self, _: &[f64], _: &[f64]) -> Jacobians {
        Jacobians { a: self.a.clone(), b: self.b.clone() }
    }
}

/// z' = z + u³: no plan's quadratic model is right.
struct Cubic;

impl Dynamics for Cubic {
    fn latent(&self) -> usize {
        1
    }

    fn action(&self) -> usize {
        1
    }

    fn next(&mut self, z: &[f64], u: &[f64], next: &mut [f64]) {
        next[0] = z[0] + u[0] * u[0] * u[0];
    }

    fn jacobians(&mut self, _: &[f64], u: &[f64]) -> Jacobians {
        Jacobians { a: Matrix::diagonal(1, 1.0), b: Matrix::diagonal(1, 3.0 * u[0] * u[0]) }
    }
}

fn rng() -> Rng {
    Rng::seed_from_u64(3)
}

/// With z' = z + u and q = r the gains of T = 1, 2, 3, … steps are every second quotient of Fibonacci's numbers.
#[test]
fn the_gain_of_an_integrator_is_a_quotient_of_fibonaccis_numbers() {
    for (steps, gain) in [(1, 1.0 / 2.0), (2, 3.0 / 5.0), (3, 8.0 / 13.0), (4, 21.0 / 34.0), (5, 55.0 / 89.0)] {
        let settings = Ilqr { state_cost: 1.0, plan_length: steps, ..Ilqr::default() };
        let integrator = Affine { a: Matrix::diagonal(1, 1.0), b: Matrix::diagonal(1, 1.0), c: vec![0.0], action: 1 };
        let action = Planner::new(&settings, integrator, vec![1.0], rng()).act(&[-2.0], 100)[0];
        assert!((action - 3.0 * gain).abs() < 1e-9, "{steps} steps: {action} and {}", 3.0 * gain);
    }
}

/// The cost is quadratic in the actions, so its values at a few points give its gradient and Hessian exactly.
#[test]
fn a_plan_on_affine_dynamics_is_the_minimum_of_its_cost() {
    let mut rng = rng();
    for (latent, action, steps) in [(1, 1, 1), (2, 2, 10), (3, 1, 7), (8, 3, 5)] {
        let dynamics = Affine::random(latent, action, &mut rng);
        let mut z = vec![0.0; 2 * latent];
        sampling::fill_normal(&mut rng, &mut z);
        let settings = Ilqr { state_cost: 3.0, action_cost: 0.5, ..Ilqr::default() };
        let mut planner = Planner::new(&settings, dynamics, z.split_off(latent), self::rng());
        let count = steps * action;
        let plan = planner.improve(&z, &vec![0.3; count]);
        let mut cost = |which: &[usize], size: f64| {
            let mut actions = vec![0.0; count];
            which.iter().for_each(|&i| actions[i] += size);
            planner.follow(&z, count, |t, _, u| u.copy_from_slice(&actions[t * action..][..action])).cost
        };
        let slopes = (0..count).map(|i| 0.5 * (cost(&[i], 1.0) - cost(&[i], -1.0))).collect();
        let mut bend = |i, j| cost(&[i, j], 1.0) - cost(&[i], 1.0) - cost(&[j], 1.0) + cost(&[], 1.0);
        let bends = (0..count * count).map(|at| bend(at / count, at % count)).collect();
        let best = Matrix::new(count, bends).cholesky().expect("a minimum").solve_from_root(&Matrix::column(slopes));
        for i in 0..count {
            let rest = plan.u[i] + best.of(i, 0);
            assert!(rest.abs() < 1e-7, "{latent} codes, {action} actions, entry {i}: {rest}");
        }
    }
}

#[test]
fn more_iterations_never_cost_more() {
    let settings = Ilqr { iterations: 0, ..Ilqr::default() };
    let actions = [0.5, -0.8, 0.1, 0.9];
    let mut before = Planner::new(&settings, Cubic, vec![2.0], rng()).improve(&[0.0], &actions).cost;
    for iterations in 1..30 {
        let settings = Ilqr { iterations, ..settings.clone() };
        let cost = Planner::new(&settings, Cubic, vec![2.0], rng()).improve(&[0.0], &actions).cost;
        assert!(cost <= before, "{cost} after {iterations} iterations, {before} before");
        before = cost;
    }
    assert!(before < 55.0, "{before}");
}

/// The position moves by the velocity, and an action of 1 changes the velocity by 0.1.
fn cart() -> Affine {
    let a = Matrix::new(2, vec![1.0, 0.5, 0.0, 1.0]);
    Affine { a, b: Matrix::new(1, vec![0.0, 0.1]), c: vec![0.0; 2], action: 1 }
}

#[test]
fn a_control_limited_plan_costs_less_than_one_whose_actions_are_cut_afterwards() {
    let plan = |control_limited| {
        let settings = Ilqr { iterations: 30, control_limited, ..Ilqr::default() };
        let mut planner = Planner::new(&settings, cart(), vec![0.0; 2], rng());
        let u = planner.improve(&[2.0, 0.0], &[0.0; 20]).u;
        let cut: Vec<f64> = u.iter().map(|u| u.clamp(-1.0, 1.0)).collect();
        let cost = planner.follow(&[2.0, 0.0], 20, |t, _, u| u[0] = cut[t]).cost;
        (u.iter().fold(0.0_f64, |most, u| most.max(u.abs())), cost)
    };
    let ((most, cost), (most_free, cost_cut)) = (plan(true), plan(false));
    assert!(most <= 1.0 && most_free > 2.0, "{most} and {most_free}");
    assert!(cost < 0.99 * cost_cut, "{cost} and {cost_cut}");
}

/// Where an action is at a limit, the cost falls beyond it; everywhere else its slope is zero.
#[test]
fn a_control_limited_plan_on_affine_dynamics_is_the_minimum_within_its_limits() {
    let mut rng = rng();
    let mut at_limits = 0;
    for (latent, action, steps) in [(1, 1, 4), (2, 2, 10), (3, 1, 7), (8, 3, 5)] {
        let dynamics = Affine::random(latent, action, &mut rng);
        let mut z = vec![0.0; 2 * latent];
        sampling::fill_normal(&mut rng, &mut z);
        let settings =
            Ilqr { state_cost: 3.0, action_cost: 0.5, iterations: 200, control_limited: true, ..Ilqr::default() };
        let mut planner = Planner::new(&settings, dynamics, z.split_off(latent), self::rng());
        let u = planner.improve(&z, &vec![0.3; steps * action]).u;
        for i in 0..u.len() {
            let mut cost = |change: f64| {
                let mut moved = u.clone();
                moved[i] += change;
                planner.follow(&z, u.len(), |t, _, u| u.copy_from_slice(&moved[t * action..][..action])).cost
            };
            // The cost is quadratic, so this is its slope.
            let slope = (cost(0.5) - cost(-0.5)) / 1.0;
            at_limits += usize::from(u[i].abs() == 1.0);
            let is_best = if u[i].abs() == 1.0 { slope * u[i] <= 0.0 } else { slope.abs() < 1e-4 };
            assert!(is_best, "{latent} codes, {action} actions, entry {i}: {} with slope {slope}", u[i]);
        }
    }
    assert!(at_limits > 5, "{at_limits} actions at their limits");
}

#[test]
fn the_chosen_plan_is_shifted_and_the_others_are_drawn_again() {
    let settings = Ilqr::default();
    let mut planner = Planner::new(&settings, Cubic, vec![2.0], rng());
    planner.applied = Some(Applied { which: 1, u: vec![1.5, 2.5, 3.5] });
    let uniform = planner.first_actions(0, 3);
    assert_eq!(planner.first_actions(1, 3), [2.5, 3.5, 3.5]);
    assert_ne!(planner.first_actions(0, 3), uniform);
    assert!(uniform.iter().all(|u| u.abs() < 1.0));
    assert!(planner.first_actions(3, 50).iter().all(|u| u.abs() == 1.0), "the fourth begins at the limits");
    planner.applied = Some(Applied { which: 0, u: vec![1.5, 2.5, 3.5] });
    assert_eq!(planner.first_actions(0, 1), [2.5], "the episode ends");
}

#[test]
fn a_plan_is_no_longer_than_the_episode() {
    let settings = Ilqr::default();
    let mut planner = Planner::new(&settings, Cubic, vec![2.0], rng());
    for (left, length) in [(12, 10), (11, 10), (10, 10), (9, 9), (2, 2), (1, 1)] {
        planner.act(&[0.0], left);
        assert_eq!(planner.applied.as_ref().map(|applied| applied.u.len()), Some(length));
    }
}

#[test]
fn equal_streams_give_equal_plans() {
    let settings = Ilqr::default();
    let act = |rng: Rng| {
        let mut planner = Planner::new(&settings, Cubic, vec![2.0], rng);
        [planner.act(&[0.0], 40), planner.act(&[0.1], 39)]
    };
    assert_eq!(act(rng()), act(rng()));
    assert_ne!(act(rng()), act(Rng::seed_from_u64(4)));
}

/// Dynamics that run away give no numbers to compare; an action comes out all the same.
#[test]
fn a_plan_that_leaves_the_numbers_is_never_preferred() {
    let settings = Ilqr { plan_length: 100, ..Ilqr::default() };
    let exploding = Affine { a: Matrix::diagonal(1, 1e300), b: Matrix::diagonal(1, 1.0), c: vec![1.0], action: 1 };
    let mut planner = Planner::new(&settings, exploding, vec![0.0], rng());
    assert_eq!(planner.improve(&[1.0], &[0.0; 100]).cost, f64::INFINITY);
    assert!(planner.act(&[1.0], 100)[0].is_finite());
}
