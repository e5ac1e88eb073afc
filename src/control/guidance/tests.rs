use rand::SeedableRng as _;

use super::*;
use crate::num::{instruction_sets::on_every_instruction_set, math};

fn exact(temperature: f64) -> Guidance {
    Guidance { temperature, discount: 0.5, bound: 30.0, normalize: false, ..Guidance::default() }
}

#[test]
fn weights_are_the_papers_exponentials() {
    // tau/gamma = 1/2: exponents 0, ln 2 and -ln 4.
    let (two, four) = (math::ln(2.0), math::ln(4.0));
    let weights = exact(0.25).weights(&[0.0, 2.0 * two, -2.0 * four]);
    for (weight, want) in weights.iter().zip([1.0, 2.0, 0.25]) {
        assert!((weight - want).abs() < 1e-6, "{weights:?}");
    }
    assert_eq!(exact(0.0).weights(&[-3.0, 0.0, 1e9]), [1.0; 3]);
}

#[test]
fn normalized_weights_have_mean_one_and_ignore_a_constant_in_all_errors() {
    let guidance = Guidance { normalize: true, ..exact(0.25) };
    let errors = [-4.0, 0.5, 1.0, 3.0, -20.0];
    let weights = guidance.weights(&errors);
    assert!((weights.iter().sum::<f32>() / 5.0 - 1.0).abs() < 1e-6);
    let shifted = guidance.weights(&errors.map(|error| error - 1000.0));
    assert!(weights.iter().zip(shifted).all(|(a, b)| (a - b).abs() < 1e-3 * a));
    assert!((weights[3] / weights[1] - (0.25 * 2.5 / 0.5_f32).e_to()).abs() < 1e-4, "ratios stay exponential");
}

#[test]
fn no_reward_makes_a_weight_overflow() {
    let quadratic = [-6946.0, -4398.0, -1108.0, 600.0, 2630.0];
    let bounded = Guidance { bound: 2.0, ..Guidance::default() }.weights(&quadratic);
    let spread = Spread::of(&bounded);
    assert!(spread.effective_share > 0.3 && spread.largest / spread.smallest <= 4.0_f64.exp() * 1.001, "{spread:?}");
    assert!(Guidance { bound: 30.0, ..exact(1.0) }.weights(&quadratic).iter().all(|weight| weight.is_finite()));
}

#[test]
fn the_effective_share_counts_transitions_that_matter() {
    assert_eq!(Spread::of(&[2.0; 7]), Spread { effective_share: 1.0, smallest: 2.0, largest: 2.0 });
    assert_eq!(Spread::of(&[1.0, 0.0, 0.0, 0.0]).effective_share, 0.25);
}

/// One transition with noiseless codes; critics and actor return constants.
#[test]
fn a_td_error_is_reward_minus_q_plus_the_discounted_soft_value() {
    let mut rng = Rng::seed_from_u64(3);
    let alpha = 0.25_f32;
    let mut agent = Agent::new(2, 1, None, math::ln(alpha), &mut rng);
    for (critic, value) in agent.critics.iter_mut().zip([-2.0, -3.0]) {
        critic.arena.fill(0.0);
        *critic.arena.last_mut().expect("a bias") = value;
    }
    // tanh(0 + sigma epsilon) with the smallest sigma: ln pi is known up to epsilon.
    agent.acting.fill(0.0);
    *agent.acting.last_mut().expect("a bias") = -5.0;
    let certain = [-87.0; 2];
    let [now, next] = [[0.0, 0.0], [3.0, 4.0]].map(|mean| [mean, certain].concat());
    let transitions = LatentTransitions { now: &now, next: &next, actions: &[0.5], goals: &[0.0, 0.0] };
    let guidance = Guidance { samples: 4000, ..exact(1.0) };
    let error = guidance.td_errors(&agent, &transitions, &mut rng)[0];
    // r = -5, Q = -3, V = -3 - alpha E[ln pi], E[ln pi] = -1/2 - ln sigma - ln(2 pi)/2 = 3.5811 where tanh is flat.
    let want = -5.0 + 3.0 + 0.5 * (-3.0 - alpha * 3.5811);
    assert!((error - want).abs() < 0.02, "{error} is not {want}");
    let kappa = Guidance { reward: Reward::Quadratic, samples: 1, ..exact(1.0) };
    let other = kappa.td_errors(&agent, &transitions, &mut rng)[0];
    assert!((other - error + 50.0 * 25.0 + 0.25 - 5.0).abs() < 1.0, "{other}");
}

#[test]
fn every_instruction_set_gives_the_same_errors_and_chunks_do_not_matter() {
    let mut rng = Rng::seed_from_u64(4);
    let agent = Agent::new(3, 2, None, 0.0, &mut rng);
    let count = AT_ONCE + 9;
    let [mut now, mut next, mut actions, mut goals] = [6, 6, 2, 3].map(|width| vec![0.0_f32; width * count]);
    for columns in [&mut now, &mut next, &mut actions, &mut goals] {
        sampling::fill_normal(&mut rng, columns);
    }
    let transitions = LatentTransitions { now: &now, next: &next, actions: &actions, goals: &goals };
    let guidance = Guidance { samples: 2, ..Guidance::default() };
    on_every_instruction_set(|| {
        let errors = guidance.td_errors(&agent, &transitions, &mut Rng::seed_from_u64(5));
        errors.iter().map(|error| error.to_bits()).collect::<Vec<_>>()
    });
    let first = LatentTransitions {
        now: &now[..6 * AT_ONCE],
        next: &next[..6 * AT_ONCE],
        actions: &actions[..2 * AT_ONCE],
        goals: &goals[..3 * AT_ONCE],
    };
    let all = guidance.td_errors(&agent, &transitions, &mut Rng::seed_from_u64(5));
    assert_eq!(guidance.td_errors(&agent, &first, &mut Rng::seed_from_u64(5)), all[..AT_ONCE]);
}
