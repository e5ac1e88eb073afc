//! What holds in every task: ranges, pictures, randomness, goals, maps; and what the best controllers reach.

use std::f64::consts::PI;

use carl_pipe::{
    control::{
        OraclePolicy,
        episodes::{self, Episode, Streams, Unstick},
    },
    env::{Preset, Simulator, Snapshot, Start, System, Task},
    num::rng::Rng,
};
use proptest::prelude::*;
use rand::SeedableRng as _;
use serde_json::{Value, json};

fn read(task: &Value) -> Task {
    let task: Task = serde_json::from_value(task.clone()).expect("a task");
    assert_eq!(task.check(), []);
    task
}

fn open(task: &Value) -> Box<dyn System> {
    read(task).system().expect("equations")
}

/// Every system there is, and the range of each component of its state.
fn all() -> Vec<(Value, Vec<(f64, f64)>)> {
    let symmetric = |reach: &[f64]| reach.iter().map(|reach| (-reach, *reach)).collect::<Vec<_>>();
    let joints = [PI, PI / 2.0, 2.0 * PI / 3.0, PI / 2.0, PI / 3.0, PI / 2.0];
    let cart = symmetric(&[PI, 2.0 * PI, f64::INFINITY, 6.0]);
    vec![
        (json!({ "env": "planar" }), vec![(1.5, 38.5); 2]),
        (json!({ "env": "swing_up" }), symmetric(&[PI, 3.0 * PI])),
        (json!({ "env": "swing_up", "step": 0.02, "torque": 1.0 }), symmetric(&[PI, 3.0 * PI])),
        (json!({ "env": "cart_pole" }), cart.clone()),
        (json!({ "env": "cart_pole", "step": 0.02 }), cart),
        (json!({ "env": "three_pole" }), symmetric(&joints)),
        (json!({ "env": "three_pole", "links": 2 }), symmetric(&joints[..4])),
    ]
}

fn is_in(state: &[f64], ranges: &[(f64, f64)]) -> bool {
    state.len() == ranges.len() && state.iter().zip(ranges).all(|(s, (low, high))| (*low..=*high).contains(s))
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 40, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn states_keep_their_ranges_whatever_the_action(seed: u64, push in -3.0..3.0) {
        for (task, ranges) in all() {
            let (env, mut rng) = (open(&task), Rng::seed_from_u64(seed));
            let mut state = env.sample_state(&mut rng).expect("a state");
            for _ in 0..10 {
                prop_assert!(is_in(&state, &ranges), "{task}: {state:?}");
                let action: Vec<f64> = env.sample_action(&mut rng).iter().map(|u| u * push).collect();
                let next = env.step(&state, &action, &mut rng);
                let clipped: Vec<f64> =
                    action.iter().zip(env.action_limit()).map(|(u, limit)| u.clamp(-limit, *limit)).collect();
                prop_assert_eq!(&next, &env.step(&state, &clipped, &mut rng), "limits of {}", task);
                state = next;
            }
        }
    }

    #[test]
    fn the_same_state_action_and_stream_give_the_same_next_state(seed: u64) {
        for (mut task, _) in all() {
            let sampled = |env: &dyn System| {
                let mut rng = Rng::seed_from_u64(seed);
                (env.sample_state(&mut rng).expect("a state"), env.sample_action(&mut rng))
            };
            let env = open(&task);
            let (state, action) = sampled(&*env);
            let step = |env: &dyn System, seed| env.step(&state, &action, &mut Rng::seed_from_u64(seed));
            prop_assert_eq!(step(&*env, 1), step(&*env, 2), "{} has no noise", task);
            task["noise"] = json!(0.1);
            let noisy = open(&task);
            prop_assert_eq!(step(&*noisy, 1), step(&*noisy, 1));
            prop_assert_ne!(step(&*noisy, 1), step(&*noisy, 2));
        }
    }

    #[test]
    fn an_observation_is_the_older_frame_and_then_the_newer(seed: u64) {
        for (task, _) in all() {
            let (env, mut rng) = (open(&task), Rng::seed_from_u64(seed));
            let [before, state] = [(); 2].map(|()| env.sample_state(&mut rng).expect("a state"));
            let frames = env.frames();
            let frame = |state: &[f64]| {
                let mut frame = vec![1; frames.pixels()];
                env.render(state, &mut frame);
                frame
            };
            prop_assert_eq!(frames.observation(), (frames.count * frames.height, frames.width));
            let want = if frames.count == 1 { frame(&state) } else { [frame(&before), frame(&state)].concat() };
            let seen = env.observe(&before, &state);
            prop_assert!(seen.iter().all(|&p| p == 0 || p == 255) && seen.contains(&255), "{task}");
            prop_assert!(seen == want, "{task}");
            prop_assert_eq!(env.observe_at_rest(&state), frame(&state).repeat(frames.count));
        }
    }

    #[test]
    fn starts_and_random_states_are_states_and_goals_are_reached(seed: u64) {
        for (task, ranges) in all() {
            let (env, mut rng) = (open(&task), Rng::seed_from_u64(seed));
            for is_preferred in [false, true] {
                prop_assert!(is_in(&env.sample_biased(is_preferred, &mut rng).expect("a state"), &ranges), "{task}");
            }
            prop_assert!(is_in(&env.sample_start(Start::Usual, &mut rng), &ranges), "{task}");
            for goal in env.goals() {
                prop_assert!(is_in(&goal, &ranges) && env.at_goal(&goal, &goal, env.goal_radius()), "{task}");
            }
        }
    }
}

#[test]
fn the_region_that_biased_sampling_prefers_holds_no_goal() {
    let mut rng = Rng::seed_from_u64(0);
    for task in ["planar", "swing_up", "cart_pole"].map(|env| json!({ "env": env })) {
        let env = open(&task);
        for _ in 0..300 {
            let state = env.sample_biased(true, &mut rng).expect("a state");
            let is_at_goal = env.goals().iter().any(|goal| env.at_goal(&state, goal, env.goal_radius()));
            assert!(!is_at_goal, "{task}: {state:?}");
        }
    }
}

/// The appendix: which angles the two parts of the biased samples have, and their shares.
#[test]
fn biased_samples_are_those_of_the_paper() {
    type Angles = fn(&[f64]) -> bool;
    let rows: [(&str, f64, Angles, Angles); 4] = [
        ("planar", 0.5, |s| s.iter().all(|x| (1.5..=31.5).contains(x)), |s| s.iter().any(|x| *x > 31.5)),
        ("swing_up", 0.95, |s| (2.0..=PI).contains(&s[0].abs()), |s| s[0].abs() <= 0.5),
        ("cart_pole", 0.8, |s| (PI / 10.0..=PI / 6.0).contains(&s[0].abs()), |s| s[0].abs() < PI / 10.0),
        (
            "three_pole",
            0.2,
            |s| s[0].abs() <= PI / 2.0 && s[2].abs() <= PI / 3.0 && s[4].abs() <= PI / 6.0,
            |s| s[0].abs() > PI / 2.0,
        ),
    ];
    let mut rng = Rng::seed_from_u64(0);
    for (name, share, preferred, else_where) in rows {
        let (task, given) = (read(&json!({ "env": name })), json!({ "region": "biased" }));
        let defaults = task.defaults("generate_data", Preset::Recipe, given.as_object().expect("a table"));
        assert_eq!(defaults["region"]["biased"]["preferred_share"], share, "{name}");
        let env = task.system().expect("equations");
        let mut sample = |is_preferred: bool| {
            (0..400).map(|_| env.sample_biased(is_preferred, &mut rng).expect("a state")).collect::<Vec<_>>()
        };
        assert!(sample(true).iter().all(|state| preferred(state)), "{name}");
        assert!(sample(false).iter().filter(|state| else_where(state)).count() > 60, "{name}");
    }
}

#[test]
fn a_map_shows_every_place_once() {
    for (task, ranges) in all() {
        let env = open(&task);
        let states = env.map_states();
        let mut cells: Vec<_> = states.iter().map(|(_, cell)| *cell).collect();
        cells.sort_unstable();
        cells.dedup();
        assert_eq!(cells.len(), states.len(), "{task}");
        for (state, _) in &states {
            assert!(is_in(state, &ranges), "{task}: {state:?}");
            assert!(
                env.place(state).expect("a position").iter().all(|share| (0.0..=1.0).contains(share)),
                "{task}: {state:?}"
            );
            assert_eq!(env.before(state).len(), state.len());
        }
    }
}

#[test]
fn the_state_before_leads_about_to_the_state() {
    // Nothing is pushed; what gravity does within a step is left out.
    let mut rng = Rng::seed_from_u64(0);
    for (task, state) in [
        (json!({ "env": "swing_up" }), vec![0.1, 3.0]),
        (json!({ "env": "cart_pole" }), vec![0.1, 1.0, 0.5, -2.0]),
        (json!({ "env": "three_pole" }), vec![0.1, 0.3, 0.05, -0.2, 0.0, 0.1]),
    ] {
        let env = open(&task);
        let rest = vec![0.0; env.action_limit().len()];
        let again = env.step(&env.before(&state), &rest, &mut rng);
        let off = again.iter().zip(&state).step_by(2).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(off < 0.03, "{task}: {again:?} instead of {state:?}");
    }
}

/// Runs the controller that knows true states; `watch` sees the simulator after every step.
fn run_oracle(
    task: &Task,
    simulator: &mut dyn Simulator,
    (goal, steps): (usize, usize),
    rng: &mut Rng,
    watch: impl FnMut(&dyn Simulator),
) {
    let mut oracle = OraclePolicy::of(task).expect("an oracle");
    let episode = Episode { goal, steps, unstick: Unstick::Off, random_from: None };
    let streams = Streams { acting: rng, plans: Rng::seed_from_u64(0) };
    episodes::run(simulator, &mut oracle, episode, streams, watch).expect("an episode");
}

/// Mean %-goal of the controller that knows true states, counting T+1 states.
fn oracle_percent(task: &Value, episodes: usize) -> f64 {
    let (task, mut rng) = (read(task), Rng::seed_from_u64(7));
    let (mut simulator, spec) = (task.open().expect("a simulator"), task.spec());
    let steps = spec.horizon + 1;
    let mut hits = 0;
    for goal in episodes::draw_goals(episodes, spec.goals, &mut rng) {
        simulator.reset(Start::Usual, goal, &mut rng).expect("a start");
        let watch = |simulator: &dyn Simulator| hits += usize::from(simulator.is_at_goal(spec.goal_radius));
        run_oracle(&task, &mut *simulator, (goal, steps), &mut rng, watch);
    }
    100.0 * hits as f64 / (episodes * steps) as f64
}

#[test]
fn oracles_reach_the_ceilings() {
    for (task, episodes) in [
        (json!({ "env": "planar" }), 300),
        (json!({ "env": "swing_up" }), 10),
        (json!({ "env": "swing_up", "step": 0.04, "torque": 1.0 }), 10),
        (json!({ "env": "swing_up", "step": 0.02, "torque": 1.0 }), 10),
        (json!({ "env": "swing_up", "step": 0.02 }), 10),
        (json!({ "env": "cart_pole" }), 500),
        (json!({ "env": "cart_pole", "step": 0.02 }), 500),
    ] {
        let percent = oracle_percent(&task, episodes);
        let ceiling = read(&task).ceiling_of(Start::Usual).expect("a known ceiling");
        println!("{task}: {percent:.2} of {ceiling}");
        assert!((percent - ceiling).abs() < 0.5, "{task}: {percent}, not {ceiling}");
    }
}

#[test]
fn the_oracle_of_the_cart_pole_loses_nothing_from_within_the_goal() {
    let mut rng = Rng::seed_from_u64(0);
    for step in [0.02, 0.05] {
        let task = read(&json!({ "env": "cart_pole", "step": step }));
        let mut simulator = task.open().expect("a simulator");
        for theta in [-PI / 10.0, 0.2, PI / 10.0] {
            simulator.restore(&Snapshot::at_rest(vec![theta, 0.0, 0.0, 0.0]), 0).expect("a start");
            run_oracle(&task, &mut *simulator, (0, 201), &mut rng, |simulator| {
                assert!(simulator.is_at_goal(PI / 10.0), "from {theta}");
                let state = &simulator.snapshot().expect("a state").state;
                assert!(state[2].abs() < 2.4, "the cart stays in the picture");
            });
        }
    }
}

#[test]
fn the_oracle_of_the_arm_swings_up_and_balances() {
    let percent = oracle_percent(&json!({ "env": "three_pole" }), 1);
    println!("three_pole: {percent:.2}");
    assert!(percent >= 88.0, "{percent}");
}

#[test]
fn options_without_a_known_ceiling_have_none() {
    for task in [
        json!({ "env": "planar", "noise": 1.0 }),
        json!({ "env": "swing_up", "step": 0.03 }),
        json!({ "env": "cart_pole", "step": 0.03 }),
        json!({ "env": "three_pole", "links": 2 }),
    ] {
        assert_eq!(read(&task).ceiling_of(Start::Usual), None, "{task}");
    }
}
