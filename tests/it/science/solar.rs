//! SOLAR's chain at every size, and its controller with a perfect latent space: the true position stands in for what an
//! encoder sees.

use carl_pipe::{
    env::{Start, System, Task},
    num::{rng::Rng, sampling},
    solar::{
        LinearGaussianPolicy, Small,
        chain::{Chain, Evidence, EvidenceGradient, chain},
        filter::Filter,
        iteration::{Costs, Progress, Settings},
        local_dynamics::{LocalFit, Rollouts},
        mniw::{Expected, Mniw},
    },
};
use rand::SeedableRng as _;

/// What the encoder's standard deviation would be.
const STD: f64 = 0.01;

/// The latent state of a position: centred, with a standard deviation of about 1.
fn latent(state: &[f64]) -> [f64; 2] {
    [0, 1].map(|i| (state[i] - 20.0) / 10.0)
}

/// One episode: the rollouts get its potentials and actions, `costs` its costs. Gives the percent of time at the goal.
fn episode(
    system: &dyn System,
    (policy, dynamics): (&LinearGaussianPolicy, &[Expected]),
    is_noisy: bool,
    (rollouts, costs): (&mut Rollouts, &mut Vec<f64>),
    rng: &mut Rng,
) -> f64 {
    let (goal, limit) = (&system.goals()[0], system.action_limit());
    let mut state = system.sample_start(Start::Usual, rng);
    let (mut filter, mut hits) = (Filter::new(2), 0);
    let steps = system.horizon() + 1;
    for t in 0..steps {
        let z = latent(&state);
        let (precision, linear) = ([1.0 / (STD * STD); 2], z.map(|z| z / (STD * STD)));
        filter.observe(&precision, &linear);
        let (mean, _) = filter.moments().unwrap();
        let mut noise = [0.0; 2];
        sampling::fill_normal(rng, &mut noise);
        let noise = is_noisy.then(|| Small::column(&noise));
        let action: Vec<f64> = policy.action(t, &mean, noise.as_ref()).iter().map(|a| a.clamp(-1.0, 1.0)).collect();
        if t < system.horizon() {
            rollouts.precision.extend(precision);
            rollouts.linear.extend(linear);
            rollouts.actions.extend(&action);
            let away: f64 = latent(goal).iter().zip(z).map(|(goal, z)| (goal - z).powi(2)).sum();
            costs.push(50.0 * away + 0.5 * ACTION_COST * action.iter().map(|a| a * a).sum::<f64>());
        }
        filter.advance(&dynamics[t.min(dynamics.len() - 1)], &action).unwrap();
        let in_units: Vec<f64> = action.iter().zip(limit).map(|(share, limit)| share * limit).collect();
        state = system.step(&state, &in_units, rng);
        hits += usize::from(system.at_goal(&state, goal, system.goal_radius()));
    }
    100.0 * hits as f64 / steps as f64
}

const ACTION_COST: f64 = 1.0;

/// The percent of time at the goal by mean actions, after ten iterations of forty rollouts.
fn percent_goal(system: &dyn System, seed: u64) -> f64 {
    let mut rng = Rng::seed_from_u64(seed);
    let steps = system.horizon();
    let prior = Mniw { psi: Small::diagonal(2, 0.002), ..Mniw::prior(2, 4) };
    let (global, mut dynamics) = (vec![prior.natural().unwrap()], vec![prior.expected().unwrap()]);
    let mut progress = Progress::new(LinearGaussianPolicy::random(steps, 2, &[0.5; 2]));
    let mut chain = chain(2, 2, steps);
    let fit = LocalFit { strength: 50.0, action_variance: 1e-4, tolerance: 1e-3, sweeps: 100 };
    let settings = Settings { fit, kl_step: 2.0, action_cost: ACTION_COST };
    let run = |progress: &Progress, dynamics: &[Expected], is_noisy, count, rng: &mut Rng| {
        let mut rollouts = Rollouts { steps, d: 2, m: 2, ..Rollouts::default() };
        let (mut costs, mut percent) = (Vec::new(), 0.0);
        for _ in 0..count {
            let policy = (&progress.policy, dynamics);
            percent += episode(system, policy, is_noisy, (&mut rollouts, &mut costs), rng) / f64::from(count);
        }
        (rollouts, costs, percent)
    };
    for _ in 0..10 {
        let (rollouts, costs, _) = run(&progress, &dynamics, true, 40, &mut rng);
        let costs = Costs::Observed(&costs);
        let report = progress.improve(&rollouts, &global, costs, &settings, &mut *chain).expect("finite numbers");
        dynamics = report.local.expected;
    }
    run(&progress, &dynamics, false, 10, &mut rng).2
}

#[test]
fn with_a_perfect_latent_space_solar_reaches_the_planar_goal() {
    let task: Task = serde_json::from_value(serde_json::json!({ "env": "planar" })).unwrap();
    let system = task.system().unwrap();
    let percents = [1, 2, 3].map(|seed| percent_goal(&*system, seed));
    println!("{percents:?}");
    assert!(percents.iter().filter(|&&percent| percent >= 75.0).count() >= 2, "{percents:?}");
}

/// Random potentials, actions and dynamics, and <weights, sample> as a function of them.
struct Scene {
    d: usize,
    chain: Box<dyn Chain>,
    /// J and h.
    potentials: [Vec<f64>; 2],
    actions: Vec<f64>,
    noise: Vec<f64>,
    weights: Vec<f64>,
}

impl Scene {
    fn new(d: usize, m: usize, steps: usize) -> Self {
        let mut rng = Rng::seed_from_u64(d as u64);
        let mut normal = |count: usize| {
            let mut numbers = vec![0.0; count];
            sampling::fill_normal(&mut rng, &mut numbers);
            numbers
        };
        let p = d + m;
        let random = |numbers: &[f64]| {
            let m = Small::from_rows(d, p, numbers);
            let m = Small::from_fn(d, p, |i, j| 0.3 * m.at(i, j) + if i == j { 0.7 } else { 0.0 });
            Mniw { m, nu: d as f64 + 3.5, ..Mniw::prior(d, p) }.expected().unwrap()
        };
        let dynamics: Vec<Expected> = (1..steps).map(|_| random(&normal(d * p))).collect();
        let precision = normal(d * steps).iter().map(|x| 0.2 + x * x).collect();
        let mut chain = chain(d, m, steps);
        chain.set_dynamics(&dynamics);
        let potentials = [precision, normal(d * steps)];
        Self { d, chain, potentials, actions: normal(m * steps), noise: normal(d * steps), weights: normal(d * steps) }
    }

    /// KL(q || p), and <weights, sample>.
    fn values(&mut self, potentials: &[Vec<f64>; 2]) -> [f64; 2] {
        let evidence = Evidence { precision: &potentials[0], linear: &potentials[1] };
        self.chain.smooth(evidence, &self.actions);
        let kl = self.chain.kl();
        [kl, self.chain.sample(&self.noise).iter().zip(&self.weights).map(|(z, w)| z * w).sum()]
    }

    /// Their gradients with respect to J and h.
    fn gradients(&mut self) -> [[Vec<f64>; 2]; 2] {
        self.values(&self.potentials.clone());
        let mut made = [0; 2].map(|_| [0; 2].map(|_| vec![0.0; self.weights.len()]));
        let [[kl_j, kl_h], [sample_j, sample_h]] = &mut made;
        self.chain.kl_gradient(1.0, EvidenceGradient { precision: kl_j, linear: kl_h });
        self.chain.sample_gradient(&self.weights, EvidenceGradient { precision: sample_j, linear: sample_h });
        made
    }
}

#[test]
fn gradients_of_the_chain_equal_finite_differences_at_every_size() {
    for (d, m) in [(1, 1), (2, 2), (3, 1), (4, 4), (5, 3), (6, 1), (7, 2), (8, 3)] {
        let mut scene = Scene::new(d, m, 4);
        let gradients = scene.gradients();
        for (part, at) in (0..2).flat_map(|part| (0..4 * d).map(move |at| (part, at))) {
            const STEP: f64 = 1e-5;
            let mut moved = |by: f64| {
                let mut potentials = scene.potentials.clone();
                potentials[part][at] += by;
                scene.values(&potentials)
            };
            let (above, below) = (moved(STEP), moved(-STEP));
            for (which, name) in ["KL", "sample"].iter().enumerate() {
                let difference = (above[which] - below[which]) / (2.0 * STEP);
                let exact = gradients[which][part][at];
                let is_near = (difference - exact).abs() < 1e-6 * exact.abs().max(1.0);
                assert!(is_near, "{name}, {} with {m}, {part} {at}: {difference}, not {exact}", scene.d);
            }
        }
    }
}
