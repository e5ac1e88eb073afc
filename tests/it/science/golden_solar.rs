//! The building blocks of SOLAR against golden numbers of an independent double-precision implementation.
//!
//! Data: `CARL_GOLDEN_SOLAR` (default `tests/golden_solar`); all sizes are taken from the files.

use std::path::PathBuf;

use carl_pipe::{
    nn::{
        binary_images::BinaryImages,
        heads,
        mat::Accumulate,
        mlp::{Layout, Mlp, Pass},
    },
    solar::{
        LinearGaussianPolicy, Small,
        chain::{Chain, Evidence, EvidenceGradient, chain},
        cost_fit,
        filter::Filter,
        gaussian::Potential,
        local_dynamics::{LocalFit, Rollouts, fit},
        lqr::{LinearSystem, Quadratic, Transition, expected_cost, marginals, solve},
        mniw::{Expected, Mniw, Natural},
        objective::{CostModel, Inference},
        policy::PolicyStep,
        trust_region,
    },
};
use serde_json::Value;

/// Relative to the largest entry of an array.
const EXACT: f64 = 1e-9;
/// For gradients and for what an iteration converges to.
const LOOSE: f64 = 1e-7;

fn open(file: &str) -> Value {
    let folder =
        std::env::var_os("CARL_GOLDEN_SOLAR").map_or_else(|| PathBuf::from("tests/golden_solar"), PathBuf::from);
    let path = folder.join(file);
    let text = std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    serde_json::from_str(&text).expect("JSON")
}

/// All numbers below a value, in order.
fn numbers(value: &Value) -> Vec<f64> {
    match value {
        Value::Number(number) => vec![number.as_f64().expect("a number")],
        Value::Array(items) => items.iter().flat_map(numbers).collect(),
        other => panic!("no numbers: {other}"),
    }
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("no number: {value}"))
}

fn size(value: &Value) -> usize {
    value.as_u64().expect("a size") as usize
}

/// An array of two axes.
fn matrix(value: &Value) -> Small {
    let rows = value.as_array().expect("rows").len();
    let entries = numbers(value);
    Small::from_rows(rows, entries.len() / rows, &entries)
}

fn column(value: &Value) -> Small {
    Small::column(&numbers(value))
}

fn list(value: &Value) -> &[Value] {
    value.as_array().expect("a list")
}

/// The difference relative to the largest wanted entry must be small.
#[track_caller]
fn near(name: &str, is: impl IntoIterator<Item = f64>, want: &Value, tolerance: f64) {
    let (is, want): (Vec<f64>, Vec<f64>) = (is.into_iter().collect(), numbers(want));
    assert_eq!(is.len(), want.len(), "{name}");
    let largest = want.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
    for (at, (is, want)) in is.iter().zip(&want).enumerate() {
        assert!((is - want).abs() <= tolerance * largest.max(1e-300), "{name}[{at}]: {is}, not {want}");
    }
}

fn mniw(value: &Value) -> Mniw {
    Mniw { psi: matrix(&value["Psi"]), m: matrix(&value["M"]), v: matrix(&value["V"]), nu: number(&value["nu"]) }
}

fn natural(value: &Value) -> Natural {
    Natural { n1: matrix(&value["n1"]), n2: matrix(&value["n2"]), n3: matrix(&value["n3"]), n4: number(&value["n4"]) }
}

fn statistics(value: &Value) -> Natural {
    Natural { n1: matrix(&value["t1"]), n2: matrix(&value["t2"]), n3: matrix(&value["t3"]), n4: number(&value["t4"]) }
}

#[track_caller]
fn near_mniw(name: &str, is: &Mniw, want: &Value, tolerance: f64) {
    near(&format!("{name} Psi"), is.psi.iter(), &want["Psi"], tolerance);
    near(&format!("{name} M"), is.m.iter(), &want["M"], tolerance);
    near(&format!("{name} V"), is.v.iter(), &want["V"], tolerance);
    near(&format!("{name} nu"), [is.nu], &want["nu"], tolerance);
}

#[track_caller]
fn near_natural(name: &str, is: &Natural, want: &Value, tolerance: f64) {
    near(&format!("{name} n1"), is.n1.iter(), &want["n1"], tolerance);
    near(&format!("{name} n2"), is.n2.iter(), &want["n2"], tolerance);
    near(&format!("{name} n3"), is.n3.iter(), &want["n3"], tolerance);
    near(&format!("{name} n4"), [is.n4], &want["n4"], tolerance);
}

#[test]
fn gaussian_potentials_equal_the_golden_numbers() {
    let golden = open("gaussian.json");
    let of = |mean, sigma| Potential::of_gaussian(&column(&golden[mean]), &matrix(&golden[sigma])).unwrap();
    let (first, second) = (of("mu", "sigma"), of("mu2", "sigma2"));
    near("eta1", first.precision.scaled(-0.5).iter(), &golden["eta1"], EXACT);
    near("eta2", first.linear.iter(), &golden["eta2"], EXACT);
    let (mean, covariance) = first.moments().unwrap();
    near("e_zz", covariance.plus(1.0, &mean.times_transposed(&mean)).iter(), &golden["e_zz"], EXACT);
    near("entropy", first.entropy(), &golden["entropy"], EXACT);
    near("kl", first.kl(&second), &golden["kl_1_2"], EXACT);
    let product = first.product(&second);
    let (mean, covariance) = product.moments().unwrap();
    near("product_mu", mean.iter(), &golden["product_mu"], EXACT);
    near("product_sigma", covariance.iter(), &golden["product_sigma"], EXACT);
    near("log_integral", product.log_integral(), &golden["log_integral_of_potential_product"], EXACT);
}

#[test]
fn mniw_distributions_equal_the_golden_numbers() {
    let golden = open("mniw.json");
    let prior = mniw(&golden["prior"]);
    near_natural("prior", &prior.natural().unwrap(), &golden["prior_natural"], EXACT);
    let (d, p) = (prior.m.rows(), prior.m.columns());
    let mut data = Natural::zero(d, p);
    for (x, y) in list(&golden["X"]).iter().zip(list(&golden["Y"])) {
        let (x, y) = (column(x), column(y));
        let one =
            Natural { n1: y.times_transposed(&y), n2: y.times_transposed(&x), n3: x.times_transposed(&x), n4: 1.0 };
        data = data.plus(1.0, &one);
    }
    let natural = prior.natural().unwrap().plus(1.0, &data);
    near_natural("posterior", &natural, &golden["posterior_natural"], EXACT);
    let posterior = natural.mniw().unwrap();
    near_mniw("posterior", &posterior, &golden["posterior"], EXACT);
    let strong = prior.natural().unwrap().plus(50.0, &data).mniw().unwrap();
    near_mniw("strength 50", &strong, &golden["posterior_strength50"], EXACT);
    let expected = posterior.expected().unwrap();
    let want = &golden["expected_stats"];
    near("e1", expected.e1.iter(), &want["e1"], EXACT);
    near("e2", expected.e2.iter(), &want["e2"], EXACT);
    near("e3", expected.e3.iter(), &want["e3"], EXACT);
    near("e4", [expected.e4], &want["e4"], EXACT);
    near("E Sigma", posterior.expected_sigma().iter(), &golden["e_sigma"], EXACT);
    near("E F", posterior.m.iter(), &golden["e_F"], EXACT);
    let (log_prior, log_posterior) = (prior.log_normalizer().unwrap(), posterior.log_normalizer().unwrap());
    near("log Z prior", [log_prior], &golden["logZ_prior"], EXACT);
    near("log Z posterior", [log_posterior], &golden["logZ_posterior"], EXACT);
    let evidence = log_posterior - log_prior - data.n4 * d as f64 / 2.0 * std::f64::consts::TAU.ln();
    near("evidence", [evidence], &golden["log_evidence"], EXACT);
    near("KL(posterior || prior)", posterior.kl(&prior), &golden["kl_post_prior"], EXACT);
    near("KL(prior || posterior)", prior.kl(&posterior), &golden["kl_prior_post"], EXACT);
    let want = &golden["predictive"];
    let (location, shape, freedom) = posterior.predictive(&column(&want["x"]));
    near("predictive location", location.iter(), &want["loc"], EXACT);
    near("predictive shape", shape.iter(), &want["shape"], EXACT);
    near("predictive freedom", [freedom], &want["df"], EXACT);
}

#[test]
fn natural_gradient_steps_equal_the_golden_numbers() {
    let golden = open("natgrad.json");
    let (prior, start) = (natural(&golden["prior_natural"]), natural(&golden["q_natural"]));
    let data = statistics(&golden["batch_stats"]);
    let (rho, all, batch) = (number(&golden["rho"]), number(&golden["num_data"]), number(&golden["batch"]));
    let step = |q: &Natural| q.step(&prior, &data, rho, all, batch);
    near_natural("one step", &step(&start), &golden["after_1"], EXACT);
    let after = (0..size(&golden["steps"])).fold(start, |q, _| step(&q));
    near_natural("all steps", &after, &golden["after_steps"], EXACT);
    near_natural("fixed point", &prior.plus(all / batch, &data), &golden["fixed_point"], EXACT);
}

fn expected(value: &Value) -> Vec<Expected> {
    let of =
        |e: &Value| Expected { e1: matrix(&e["e1"]), e2: matrix(&e["e2"]), e3: matrix(&e["e3"]), e4: number(&e["e4"]) };
    list(value).iter().map(of).collect()
}

/// The potentials N(mean, std²): the diagonals of J, and h.
fn potentials(mean: &Value, std: &Value) -> (Vec<f64>, Vec<f64>) {
    let precision: Vec<f64> = numbers(std).iter().map(|std| 1.0 / (std * std)).collect();
    let linear = numbers(mean).iter().zip(&precision).map(|(mean, precision)| mean * precision).collect();
    (precision, linear)
}

#[test]
fn the_chain_equals_the_golden_numbers() {
    let golden = open("lds.json");
    let (d, m, steps) = (size(&golden["d"]), size(&golden["m"]), size(&golden["T"]));
    let actions = numbers(&golden["actions"]);
    let (precision, linear) = potentials(&golden["potential_mean"], &golden["potential_std"]);
    let nothing = vec![0.0; steps * d];
    for (block, of_mniw) in [("plugin", false), ("expected", true)] {
        let want = &golden[block];
        let dynamics = expected(&want["et"]);
        if of_mniw {
            for (t, (from_file, mniw_t)) in dynamics.iter().zip(list(&golden["mniw"])).enumerate() {
                let own = mniw(mniw_t).expected().unwrap();
                near(&format!("e3 of {t}"), own.e3.iter(), &want["et"][t]["e3"], EXACT);
                assert!((own.e4 - from_file.e4).abs() < EXACT);
            }
        }
        let mut chain = chain(d, m, steps);
        chain.set_dynamics(&dynamics);
        let without = chain.smooth(Evidence { precision: &nothing, linear: &nothing }, &actions);
        let wanted = number(&want["log_normaliser_without_potentials"]);
        assert!((without - wanted).abs() < EXACT * wanted.abs().max(1.0), "{without}, not {wanted}");
        let evidence = Evidence { precision: &precision, linear: &linear };
        near("log Z", [chain.smooth(evidence, &actions)], &want["log_normaliser"], EXACT);
        near("mean", chain.means().to_vec(), &want["mean"], EXACT);
        near("cov", chain.covariances().to_vec(), &want["cov"], EXACT);
        near("cross", chain.cross_covariances().to_vec(), &want["cross_cov_next_cur"], EXACT);
        near("kl_local", [chain.kl()], &want["kl_local"], EXACT);
        near("sample", chain.sample(&numbers(&golden["eps"])).to_vec(), &want["sample"], EXACT);
        the_gradients_of_the_chain(&mut *chain, &numbers(&want["sample_weights"]), want);
        the_statistics_of_the_chain(&*chain, &actions, d + m, want);
        the_filter(&dynamics, (&precision, &linear), &actions, (d, m), want);
    }
}

fn the_gradients_of_the_chain(chain: &mut dyn Chain, weights: &[f64], want: &Value) {
    let mut gradients = [0; 4].map(|_| vec![0.0; weights.len()]);
    let [kl_j, kl_h, sample_j, sample_h] = &mut gradients;
    chain.kl_gradient(1.0, EvidenceGradient { precision: kl_j, linear: kl_h });
    chain.sample_gradient(weights, EvidenceGradient { precision: sample_j, linear: sample_h });
    let names = ["grad_kl_Jdiag", "grad_kl_h", "grad_wsample_Jdiag", "grad_wsample_h"];
    for (name, gradient) in names.into_iter().zip(gradients) {
        near(name, gradient, &want[name], LOOSE);
    }
}

/// The golden statistics belong to actions without variance.
fn the_statistics_of_the_chain(chain: &dyn Chain, actions: &[f64], p: usize, want: &Value) {
    let transitions = list(&want["suff"]["t1"]).len();
    let d = list(&want["suff"]["t1"][0]).len();
    let mut all = vec![Natural::zero(d, p); transitions];
    let variance = action_variance(want, actions, d, p);
    chain.add_statistics(actions, 1.0, variance, &mut all);
    for (t, is) in all.iter().enumerate() {
        let of = |name: &str| &want["suff"][name][t];
        near("t1", is.n1.iter(), of("t1"), EXACT);
        near("t2", is.n2.iter(), of("t2"), EXACT);
        near("t3", is.n3.iter(), of("t3"), EXACT);
        near("t4", [is.n4], of("t4"), EXACT);
    }
}

/// The variance that the file gives an action: what its second moment exceeds the square by.
fn action_variance(want: &Value, actions: &[f64], d: usize, p: usize) -> f64 {
    let second = matrix(&want["suff"]["t3"][0]).at(d, d);
    let variance = second - actions[0] * actions[0];
    assert!(p > d && (variance.abs() < 1e-12 || (variance - 1e-4).abs() < 1e-9), "{variance}");
    if variance < 1e-6 { 0.0 } else { 1e-4 }
}

fn the_filter(
    dynamics: &[Expected],
    (precision, linear): (&[f64], &[f64]),
    actions: &[f64],
    (d, m): (usize, usize),
    want: &Value,
) {
    let mut filter = Filter::new(d);
    let (mut means, mut covariances) = (Vec::new(), Vec::new());
    for t in 0..precision.len() / d {
        filter.observe(&precision[t * d..][..d], &linear[t * d..][..d]);
        let (mean, covariance) = filter.moments().unwrap();
        means.extend(mean.iter());
        covariances.extend(covariance.iter());
        if let Some(dynamics) = dynamics.get(t) {
            filter.advance(dynamics, &actions[t * m..][..m]).unwrap();
        }
    }
    near("filtered mean", means, &want["filtered_mean"], EXACT);
    near("filtered cov", covariances, &want["filtered_cov"], EXACT);
}

/// The smoother against conditioning on the dense joint precision.
#[test]
fn the_smoother_equals_the_dense_solution() {
    let golden = open("lds.json");
    let (d, m, steps) = (size(&golden["d"]), size(&golden["m"]), size(&golden["T"]));
    let actions = numbers(&golden["actions"]);
    let (precision, linear) = potentials(&golden["potential_mean"], &golden["potential_std"]);
    let dynamics = expected(&golden["expected"]["et"]);
    let n = steps * d;
    let (mut joint, mut right) = (vec![vec![0.0; n]; n], linear.clone());
    for i in 0..n {
        joint[i][i] += precision[i] + if i < d { 1.0 } else { 0.0 };
    }
    for (t, e) in dynamics.iter().enumerate() {
        let (now, next) = (t * d, (t + 1) * d);
        for (i, j) in (0..d).flat_map(|i| (0..d).map(move |j| (i, j))) {
            joint[now + i][now + j] -= 2.0 * e.e3.at(i, j);
            joint[next + i][next + j] -= 2.0 * e.e1.at(i, j);
            joint[next + i][now + j] -= e.e2.at(i, j);
            joint[now + j][next + i] -= e.e2.at(i, j);
        }
        for (i, k) in (0..d).flat_map(|i| (0..m).map(move |k| (i, k))) {
            right[next + i] += e.e2.at(i, d + k) * actions[t * m + k];
            right[now + i] += 2.0 * e.e3.at(i, d + k) * actions[t * m + k];
        }
    }
    let equations = joint.into_iter().zip(right).map(|(mut row, right)| {
        row.push(right);
        row
    });
    let dense = carl_pipe::num::linalg::solve_augmented(equations.collect()).unwrap();
    let mut chain = chain(d, m, steps);
    chain.set_dynamics(&dynamics);
    chain.smooth(Evidence { precision: &precision, linear: &linear }, &actions);
    for (mean, dense) in chain.means().iter().zip(&dense) {
        assert!((mean - dense[0]).abs() < 1e-12, "{mean} {}", dense[0]);
    }
}

#[test]
fn local_dynamics_equal_the_golden_numbers() {
    let golden = open("local_dynamics.json");
    let (d, m, steps) = (size(&golden["d"]), size(&golden["m"]), size(&golden["T"]));
    let (precision, linear) = potentials(&golden["potential_mean"], &golden["potential_std"]);
    let rollouts = Rollouts { steps, d, m, precision, linear, actions: numbers(&golden["actions"]) };
    assert_eq!(rollouts.len(), size(&golden["R"]));
    let prior: Vec<Natural> = list(&golden["prior"]).iter().map(|prior| mniw(prior).natural().unwrap()).collect();
    for strength in [1.0, 50.0] {
        let want = &golden[format!("strength_{strength}")];
        let of = |sweeps: u64| {
            let variance = number(&golden["action_variance"]);
            let settings = LocalFit { strength, action_variance: variance, tolerance: 0.0, sweeps };
            fit(&rollouts, &prior, settings, &mut *chain(d, m, steps)).unwrap()
        };
        for sweeps in [1, 5] {
            near_dynamics(&of(sweeps).dynamics, &want["after"][sweeps.to_string()], EXACT);
        }
        let converged = of(3 * want["iterations"].as_u64().unwrap());
        near_dynamics(&converged.dynamics, &want["converged"], LOOSE);
        near("means", converged.means.clone(), &want["smoothed_mean"], LOOSE);
        let sigma = converged.dynamics.iter().flat_map(|q| q.expected_sigma().iter().collect::<Vec<_>>());
        near("E Sigma", sigma, &want["e_sigma"], LOOSE);
        let objective = &converged.objective;
        near("objective", objective[..6].to_vec(), &want["objective_first6"], EXACT);
        near("last objective", [*objective.last().unwrap()], &want["objective_last"], EXACT);
        let falls = |pair: &[f64]| pair[1] < pair[0] - 1e-9 * pair[0].abs();
        assert!(!objective.windows(2).any(falls), "the objective falls");
    }
}

#[track_caller]
fn near_dynamics(is: &[Mniw], want: &Value, tolerance: f64) {
    let all = |of: fn(&Mniw) -> Small| is.iter().flat_map(|q| of(q).iter().collect::<Vec<_>>()).collect::<Vec<_>>();
    near("Psi", all(|q| q.psi), &want["Psi"], tolerance);
    near("M", all(|q| q.m), &want["M"], tolerance);
    near("V", all(|q| q.v), &want["V"], tolerance);
    near("nu", is.iter().map(|q| q.nu), &want["nu"], tolerance);
}

fn system(golden: &Value) -> LinearSystem {
    let transitions = list(&golden["D"]).iter().zip(list(&golden["d"])).zip(list(&golden["S_D"]));
    let transition = |((d, offset), noise): ((&Value, &Value), &Value)| Transition {
        matrix: matrix(d),
        offset: column(offset),
        noise: matrix(noise),
    };
    LinearSystem {
        transitions: transitions.map(transition).collect(),
        start_mean: column(&golden["mu0"]),
        start_covariance: matrix(&golden["S0"]),
    }
}

fn costs(quadratic: &Value, linear: &Value) -> Vec<Quadratic> {
    let of = |(c, l): (&Value, &Value)| Quadratic { matrix: matrix(c), linear: column(l), constant: 0.0 };
    list(quadratic).iter().zip(list(linear)).map(of).collect()
}

fn policy(value: &Value) -> LinearGaussianPolicy {
    let parts = list(&value["K"]).iter().zip(list(&value["k"])).zip(list(&value["S"]));
    let step = |((gain, offset), covariance): ((&Value, &Value), &Value)| PolicyStep {
        gain: matrix(gain),
        offset: column(offset),
        covariance: matrix(covariance),
    };
    LinearGaussianPolicy { steps: parts.map(step).collect() }
}

#[track_caller]
fn near_policy(is: &LinearGaussianPolicy, want: &Value) {
    let all = |of: fn(&PolicyStep) -> Small| {
        is.steps.iter().flat_map(|s| of(s).iter().collect::<Vec<_>>()).collect::<Vec<_>>()
    };
    near("K", all(|step| step.gain), &want["K"], EXACT);
    near("k", all(|step| step.offset), &want["k"], EXACT);
    near("S", all(|step| step.covariance), &want["S"], EXACT);
}

#[test]
fn lqr_equals_the_golden_numbers() {
    let golden = open("lqr.json");
    let (system, costs) = (system(&golden), costs(&golden["C"], &golden["c"]));
    let solution = solve(&system, &costs).unwrap();
    near_policy(&solution.policy, &golden);
    near("V", solution.values.iter().flat_map(|(v, _)| v.iter().collect::<Vec<_>>()), &golden["V"], EXACT);
    near("v", solution.values.iter().flat_map(|(_, v)| v.iter().collect::<Vec<_>>()), &golden["v"], EXACT);
    let path = marginals(&system, &solution.policy);
    near("mu", path.iter().flat_map(|y| y.mean.iter().collect::<Vec<_>>()), &golden["mu"], EXACT);
    near("sigma", path.iter().flat_map(|y| y.covariance.iter().collect::<Vec<_>>()), &golden["sigma"], EXACT);
    near("cost", [expected_cost(&path, &costs)], &golden["expected_cost"], EXACT);
    // The actions along the mean solve the quadratic program.
    let d = system.start_mean.rows();
    let actions = path.iter().flat_map(|y| y.mean.iter().skip(d).collect::<Vec<_>>());
    near("open loop", actions, &golden["open_loop_actions"], EXACT);
}

#[test]
fn lqr_over_a_long_horizon_solves_the_riccati_equation() {
    let golden = &open("lqr.json")["riccati"];
    let (a, b) = (matrix(&golden["A"]), matrix(&golden["B"]));
    let (q, r) = (matrix(&golden["Q"]), matrix(&golden["R"]));
    let (d, m) = (b.rows(), b.columns());
    let (mut dynamics, mut cost) = (Small::zeros(d, d + m), Small::zeros(d + m, d + m));
    dynamics.set_block(0, 0, &a);
    dynamics.set_block(0, d, &b);
    cost.set_block(0, 0, &q);
    cost.set_block(d, d, &r);
    let transition = Transition { matrix: dynamics, offset: Small::zeros(d, 1), noise: Small::diagonal(d, 0.1) };
    let system = LinearSystem {
        transitions: vec![transition; 400],
        start_mean: Small::zeros(d, 1),
        start_covariance: Small::diagonal(d, 1.0),
    };
    let costs = vec![Quadratic { matrix: cost, linear: Small::zeros(d + m, 1), constant: 0.0 }; 400];
    let solution = solve(&system, &costs).unwrap();
    near("P", solution.values[0].0.iter(), &golden["P"], EXACT);
    // scipy's u = -K x; ours is u = K x.
    let gain = solution.policy.steps[0].gain;
    let is_negative = (gain.at(0, 0) > 0.0) != (numbers(&golden["K"])[0] > 0.0);
    near("K", gain.scaled(if is_negative { -1.0 } else { 1.0 }).iter(), &golden["K"], EXACT);
}

#[test]
fn the_trust_region_equals_the_golden_numbers() {
    let (problem, golden) = (open("lqr.json"), open("kl_lqr.json"));
    let (system, all_costs) = (system(&problem), costs(&problem["C"], &problem["c"]));
    let old = policy(&golden["old"]);
    let cost_of = |policy: &LinearGaussianPolicy| expected_cost(&marginals(&system, policy), &all_costs);
    near("old cost", [cost_of(&old)], &golden["old_expected_cost"], EXACT);
    for case in list(&golden["cases"]) {
        let eta = number(&case["eta_exact"]);
        let exact = trust_region::at_multiplier(&system, &all_costs, &old, eta, &mut Vec::new()).unwrap();
        near("KL", [exact.kl], &case["kl_total"], EXACT);
        near_policy(&exact.policy, case);
        let kls = trust_region::kl_of_steps(&exact.policy, &old, &exact.marginals).unwrap();
        near("KL of steps", kls, &case["kl_t"], EXACT);
        near("cost", [cost_of(&exact.policy)], &case["expected_cost"], EXACT);
        let mut trials = Vec::new();
        trust_region::improve(&system, &all_costs, &old, number(&case["kl_total"]), &mut trials).unwrap();
        near("search", trials.iter().flat_map(|&(eta, kl)| [eta, kl]), &case["search_from_1"], EXACT);
    }
    let indefinite = &golden["indefinite"];
    let costs = costs(&indefinite["C"], &problem["c"]);
    let mut tried = Vec::new();
    let eta = number(&indefinite["eta_start"]);
    let found = trust_region::at_multiplier(&system, &costs, &old, eta, &mut tried).unwrap();
    near("eta", [found.eta], &indefinite["eta_accepted"], EXACT);
    near("tried", tried, &indefinite["etas_tried"], EXACT);
}

#[test]
fn the_fitted_cost_equals_the_golden_numbers() {
    let golden = open("cost_fit.json");
    let (states, d) = (numbers(&golden["s"]), list(&golden["c"]).len());
    let of = |costs: &str, is_convex| cost_fit::fit(d, &states, &numbers(&golden[costs]), is_convex).unwrap();
    for (name, fitted, want) in [
        ("exact", of("y_exact", true), &golden),
        ("least squares", of("y_indefinite", false), &golden["least_squares"]),
        ("psd", of("y_indefinite", true), &golden["psd"]),
    ] {
        near(&format!("{name} C"), fitted.matrix.iter(), &want["C"], EXACT);
        near(&format!("{name} c"), fitted.linear.iter(), &want["c"], EXACT);
        near(&format!("{name} b"), [fitted.constant], &want["b"], EXACT);
        if let Some(mse) = want.get("mse") {
            let costs = numbers(&golden["y_indefinite"]);
            let errors = states.chunks_exact(d).zip(&costs).map(|(z, cost)| (fitted.at(z) - cost).powi(2));
            near(&format!("{name} error"), [errors.sum::<f64>() / costs.len() as f64], mse, EXACT);
        }
    }
}

#[test]
fn the_adjustment_of_the_bound_equals_the_golden_numbers() {
    for row in list(&open("step_adjust.json")["rows"]) {
        let (predicted, actual) = (number(&row["predicted"]), number(&row["actual"]));
        near("factor", [trust_region::adjustment(predicted, actual)], &row["factor"], EXACT);
        let multiplier = trust_region::adjusted(number(&row["mult"]), predicted, actual);
        near("multiplier", [multiplier], &row["new_mult"], EXACT);
    }
}

/// A tiny model: networks of one hidden layer around the structured posterior.
struct Tiny {
    layout: Layout,
    encoder: Mlp<2>,
    decoder: Mlp<2>,
    arena: Vec<f64>,
}

impl Tiny {
    fn new(golden: &Value) -> Self {
        let (d, pixels, hidden) = (size(&golden["d"]), size(&golden["Nx"]), size(&golden["hidden"]));
        let mut layout = Layout::default();
        let encoder = layout.mlp("encoder", pixels, [hidden, 2 * d]);
        let decoder = layout.mlp("decoder", d, [hidden, pixels]);
        let arena = vec![0.0; layout.len];
        let mut tiny = Self { layout, encoder, decoder, arena };
        let mut arena = std::mem::take(&mut tiny.arena);
        tiny.lay(&golden["params"], &mut arena);
        tiny.arena = arena;
        tiny
    }

    /// Writes parameters, or gradients, of the file: its weights are \[out, in\], ours \[out, in\] column by column. The two
    /// heads of the encoder are one layer here.
    fn lay(&self, from: &Value, arena: &mut [f64]) {
        let [enc, heads] = self.encoder.layers;
        let [dec, logits] = self.decoder.layers;
        for (layer, row, name) in [
            (enc, 0, "enc0"),
            (heads, 0, "enc_mean"),
            (heads, heads.n_out / 2, "enc_logstd"),
            (dec, 0, "dec0"),
            (logits, 0, "dec_logits"),
        ] {
            let (weights, biases) = (numbers(&from[format!("{name}.W")]), numbers(&from[format!("{name}.b")]));
            let (w, b) = layer.w_b_mut(arena);
            for (i, bias) in biases.iter().enumerate() {
                b[row + i] = *bias;
                for j in 0..layer.n_in {
                    w[j * layer.n_out + row + i] = weights[i * layer.n_in + j];
                }
            }
        }
    }
}

#[test]
fn the_elbo_of_a_whole_model_and_its_gradients_equal_the_golden_numbers() {
    let golden = open("elbo.json");
    let (d, m, steps, batch) = (size(&golden["d"]), size(&golden["m"]), size(&golden["T"]), size(&golden["B"]));
    let (pixels, count, beta) = (size(&golden["Nx"]), number(&golden["num_data"]), number(&golden["beta"]));
    let tiny = Tiny::new(&golden);
    let cost_of = |of: &Value| [numbers(&of["cost.C"]), numbers(&of["cost.c"])].concat();
    let cost = CostModel { weights: cost_of(&golden["params"]) };
    let read = |name: &str| -> Vec<Mniw> { list(&golden[name]).iter().map(mniw).collect() };
    let (q, prior) = (read("q"), read("prior"));
    let dynamics: Vec<Expected> = q.iter().map(|q| q.expected().unwrap()).collect();
    let pictures: Vec<f64> = numbers(&golden["x"]);
    let mut images = BinaryImages::new(&vec![0; pixels]);
    images.extend(&pictures.iter().map(|&x| x as u8).collect::<Vec<_>>());
    let (actions, costs, noise) = (numbers(&golden["actions"]), numbers(&golden["costs"]), numbers(&golden["eps"]));
    let share = 1.0 / batch as f64;
    let mut gradient = vec![0.0; tiny.layout.len];
    let mut d_cost = vec![0.0; cost.weights.len()];
    let mut mean_elbo = [0.0; 2];
    let mut statistics = vec![Natural::zero(d, d + m); steps - 1];
    let mut inference = Inference::new(d, m, steps, 0.0);
    inference.chain.set_dynamics(&dynamics);
    for b in 0..batch {
        let want = &golden["terms"][b];
        let x = &pictures[b * steps * pixels..][..steps * pixels];
        let mut encoded = Pass::new(&tiny.encoder, steps, 1);
        let mut encoded = encoded.view(steps);
        tiny.encoder.forward(&tiny.arena, x, &mut encoded);
        let codes = encoded.output().to_vec();
        let actions = &actions[b * steps * m..][..steps * m];
        near("log Z", [inference.infer(&codes, actions)], &want["log_normaliser"], EXACT);
        near("means", inference.chain.means().to_vec(), &golden["smoothed_mean"][b], EXACT);
        let kl = inference.chain.kl();
        near("kl_local", [kl], &want["kl_local"], EXACT);
        let z = inference.chain.sample(&noise[b * steps * d..][..steps * d]).to_vec();
        let mut decoded = Pass::new(&tiny.decoder, steps, 1);
        let mut decoded = decoded.view(steps);
        tiny.decoder.forward(&tiny.arena, &z, &mut decoded);
        let (logits, deltas) = decoded.output_and_delta();
        let (mut log_px, mut log_pc) = (0.0, 0.0);
        for t in 0..steps {
            let (range, image) = (t * pixels..(t + 1) * pixels, (b * steps + t) as u32);
            log_px -= heads::image(&logits[range.clone()], &images, image, share, &mut deltas[range]);
        }
        let mut d_z = vec![0.0; steps * d];
        tiny.decoder.backward(&tiny.arena, &mut decoded, Some(&mut d_z));
        for t in 0..steps {
            let (z, d_z) = (&z[t * d..][..d], &mut d_z[t * d..][..d]);
            log_pc += cost.log_likelihood(z, costs[b * steps + t], (-beta * share, d_z), (share, &mut d_cost));
        }
        near("log_px", [log_px], &want["log_px"], EXACT);
        near("log_pc", [log_pc], &want["log_pc"], EXACT);
        inference.backward(&codes, &d_z, beta * share, encoded.output_delta());
        tiny.encoder.backward(&tiny.arena, &mut encoded, None);
        tiny.encoder.gradient(1, &mut gradient, Accumulate::Add, x, &encoded);
        tiny.decoder.gradient(1, &mut gradient, Accumulate::Add, &z, &decoded);
        for (sum, beta) in mean_elbo.iter_mut().zip([1.0, beta]) {
            *sum += share * (log_px + beta * (log_pc - kl));
        }
        inference.chain.add_statistics(actions, 1.0, 1e-4, &mut statistics);
    }
    let kl_global: f64 = q.iter().zip(&prior).map(|(q, prior)| q.kl(prior).unwrap()).sum();
    near("kl_global", [kl_global], &golden["kl_global"], EXACT);
    near("elbo", [mean_elbo[0] - kl_global / count], &golden["elbo"], EXACT);
    near("beta_elbo", [mean_elbo[1] - beta * kl_global / count], &golden["beta_elbo"], EXACT);
    // The file has the gradient of the ELBO, ours is that of the loss.
    let mut want = vec![0.0; tiny.layout.len];
    tiny.lay(&golden["grad_beta_elbo"], &mut want);
    let largest = want.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
    for (at, (is, want)) in gradient.iter().zip(&want).enumerate() {
        assert!((is + want).abs() < LOOSE * largest, "gradient[{at}]: {}, not {want}", -is);
    }
    let wanted = cost_of(&golden["grad_elbo_cost"]);
    near("cost gradient", d_cost.clone(), &Value::from(wanted), LOOSE);
    let with_beta = cost_of(&golden["grad_beta_elbo"]);
    near("cost gradient with beta", d_cost.iter().map(|d| beta * d), &Value::from(with_beta), LOOSE);
    let norm = gradient.iter().map(|x| x * x).sum::<f64>().sqrt();
    near("norm", [norm], &golden["network_grad_norm"], LOOSE);
    near("clip", [(5.0 / norm).min(1.0)], &golden["clip_factor"], LOOSE);
    for (t, q) in q.iter().enumerate() {
        let prior = prior[t].natural().unwrap();
        let after = q.natural().unwrap().step(&prior, &statistics[t], number(&golden["rho"]), count, batch as f64);
        near_natural("after one step", &after, &golden["q_natural_after"][t], EXACT);
    }
}
