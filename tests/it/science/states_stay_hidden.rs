//! Training sees pictures and actions, never a true state.

use crate::support::stages;
use carl_pipe::{
    artifact::{Artifact as _, Collected, Files, TrainedModel, Transitions},
    control::{
        Acting, Agent, AgentPolicy,
        episodes::{self, Episode, Streams, Unstick},
        sac::Codes,
    },
    env::{Frames, Oracle, Planar, Simulator, Start, SwingUp, System, simulate},
    lce::trainer::Data,
    num::rng::Rng,
    record::{At, Recorder},
    stage,
};
use rand::SeedableRng as _;
use safetensors::{Dtype, SafeTensors};
use serde_json::json;

/// A task in other coordinates: what is hidden differs, what is seen does not. Powers of two keep every coordinate
/// exact.
struct Veiled<E>(E);

const VEIL: f64 = 64.0;

fn veil(state: &[f64]) -> Vec<f64> {
    // The coordinates change places too.
    state.iter().rev().map(|x| x * VEIL).collect()
}

fn unveil(state: &[f64]) -> Vec<f64> {
    state.iter().rev().map(|x| x / VEIL).collect()
}

impl<E: System> System for Veiled<E> {
    fn frames(&self) -> Frames {
        self.0.frames()
    }
    fn action_limit(&self) -> &[f64] {
        self.0.action_limit()
    }
    fn horizon(&self) -> usize {
        self.0.horizon()
    }
    fn step(&self, state: &[f64], action: &[f64], rng: &mut Rng) -> Vec<f64> {
        veil(&self.0.step(&unveil(state), action, rng))
    }
    fn render(&self, state: &[f64], frame: &mut [u8]) {
        self.0.render(&unveil(state), frame);
    }
    fn sample_state(&self, rng: &mut Rng) -> Option<Vec<f64>> {
        self.0.sample_state(rng).map(|state| veil(&state))
    }
    fn sample_biased(&self, is_preferred: bool, rng: &mut Rng) -> Option<Vec<f64>> {
        self.0.sample_biased(is_preferred, rng).map(|state| veil(&state))
    }
    fn sample_start(&self, start: Start, rng: &mut Rng) -> Vec<f64> {
        veil(&self.0.sample_start(start, rng))
    }
    fn goals(&self) -> Vec<Vec<f64>> {
        self.0.goals().iter().map(|goal| veil(goal)).collect()
    }
    fn at_goal(&self, state: &[f64], goal: &[f64], radius: f64) -> bool {
        self.0.at_goal(&unveil(state), &unveil(goal), radius)
    }
    fn goal_radius(&self) -> f64 {
        self.0.goal_radius()
    }
    fn map_states(&self) -> Vec<(Vec<f64>, [usize; 2])> {
        self.0.map_states().into_iter().map(|(state, cell)| (veil(&state), cell)).collect()
    }
    fn before(&self, state: &[f64]) -> Vec<f64> {
        veil(&self.0.before(&unveil(state)))
    }
    fn place(&self, state: &[f64]) -> Option<[f32; 2]> {
        self.0.place(&unveil(state))
    }
    fn coordinates(&self, state: &[f64]) -> Vec<f32> {
        self.0.coordinates(&unveil(state))
    }
    fn place_radius(&self, radius: f64) -> f32 {
        self.0.place_radius(radius)
    }
    fn oracle(&self) -> Option<Oracle> {
        let mut oracle = self.0.oracle()?;
        Some(Box::new(move |state, goal, rng| oracle(&unveil(state), &unveil(goal), rng)))
    }
}

const PLANAR: Planar = Planar { noise: 0.0 };

/// Random transitions of an environment, with the states that they went through.
fn transitions(env: &dyn System, samples: usize) -> (Transitions, Vec<f64>) {
    let mut rng = Rng::seed_from_u64(1);
    let goals = env.goals().iter().flat_map(|goal| env.observe_at_rest(goal)).collect();
    let (picture, action_dim) = (env.frames().observation(), env.action_limit().len());
    let mut transitions = Transitions { picture, action_dim, goals, ..Transitions::default() };
    let mut states = Vec::new();
    for _ in 0..samples {
        let (state, action) = (env.sample_state(&mut rng).expect("a state"), env.sample_action(&mut rng));
        let next = env.step(&state, &action, &mut rng);
        let scaled: Vec<f32> = action.iter().zip(env.action_limit()).map(|(u, limit)| (u / limit) as f32).collect();
        transitions.push(&env.observe_at_rest(&state), &scaled, &env.observe(&state, &next), 0);
        states.extend(state.into_iter().chain(next));
    }
    (transitions, states)
}

/// A model and an agent, trained for a moment.
fn train(transitions: &Files) -> (Files, Files) {
    let few = json!({ "epochs": 2, "warm_up": { "epochs": 1 }, "ramp": { "epochs": 1 } });
    let model = stages::run("train_lce", few, &[("transitions", &[transitions])]);
    let agent =
        stages::run("train_sac", json!({ "steps": 2 }), &[("transitions", &[transitions]), ("model", &[&model])]);
    (model, agent)
}

#[test]
fn equal_pictures_with_other_states_behind_them_train_to_the_same_bits() {
    let (seen, states) = transitions(&PLANAR, 40);
    let (veiled, veiled_states) = transitions(&Veiled(PLANAR), 40);
    assert!(states.iter().zip(&veiled_states).all(|(a, b)| a != b), "the hidden states differ");
    let [seen, veiled] = [seen, veiled].map(|transitions| transitions.save().expect("files"));
    assert!(seen == veiled && train(&seen) == train(&veiled));
}

#[test]
fn velocities_are_hidden_behind_two_frames() {
    let pendulum = SwingUp { noise: 0.0, step: 0.05, torque: 0.65 };
    let ((seen, states), (veiled, veiled_states)) = (transitions(&pendulum, 20), transitions(&Veiled(pendulum), 20));
    assert!(states.iter().zip(&veiled_states).all(|(a, b)| a != b), "the hidden states differ");
    assert_eq!(seen, veiled);
}

#[test]
fn states_that_look_the_same_are_acted_on_the_same() {
    let (data, _) = transitions(&PLANAR, 40);
    let (model, agent) = train(&data.save().expect("files"));
    let model = TrainedModel::load(&model).expect("a model").model;
    let agent = Agent::load(&agent).expect("an agent");
    let play = |system: Box<dyn System>| {
        let (mut simulator, mut rng, mut states) = (simulate(system), Rng::seed_from_u64(2), Vec::new());
        simulator.reset(Start::Usual, 0, &mut rng).expect("a start");
        let mut policy = AgentPolicy::new(&model, &agent, Acting::Sample);
        let episode = Episode { goal: 0, steps: 15, unstick: Unstick::Random, random_from: None };
        let streams = Streams { acting: &mut rng, plans: Rng::seed_from_u64(0) };
        let watch = |simulator: &dyn Simulator| states.push(simulator.snapshot().expect("a state").state.clone());
        let path = episodes::run(&mut *simulator, &mut policy, episode, streams, watch).expect("an episode");
        (path, states)
    };
    let ((seen, states), (veiled, veiled_states)) = (play(Box::new(PLANAR)), play(Box::new(Veiled(PLANAR))));
    assert_eq!((seen.len(), &seen), (15, &veiled));
    assert_eq!(states, veiled_states.iter().map(|state| unveil(state)).collect::<Vec<_>>());
}

/// What is documented in an artifact: tensors by name and type.
fn tensors(bytes: &[u8]) -> Vec<(String, Dtype)> {
    let file = SafeTensors::deserialize(bytes).expect("safetensors");
    let mut tensors: Vec<_> = file.tensors().into_iter().map(|(name, view)| (name, view.dtype())).collect();
    tensors.sort_by(|a, b| a.0.cmp(&b.0));
    tensors
}

#[test]
fn transitions_hold_what_is_documented_and_no_coordinate_of_a_state() {
    let (transitions, states) = transitions(&PLANAR, 64);
    let files = transitions.save().expect("files");
    assert_eq!(files.names().collect::<Vec<_>>(), ["transitions.safetensors"]);
    let bytes = &files.bytes("transitions.safetensors").expect("a file");
    let documented = [
        ("actions", Dtype::F32),
        ("goal_index", Dtype::U32),
        ("goals", Dtype::U8),
        ("next_observations", Dtype::U8),
        ("observations", Dtype::U8),
    ];
    assert_eq!(tensors(bytes), documented.map(|(name, dtype)| (name.to_owned(), dtype)));
    let file = SafeTensors::deserialize(bytes).expect("safetensors");
    for (name, view) in file.tensors() {
        match view.dtype() {
            // Coordinates lie in 1.5..38.5: raw, per side, per action limit or centred, none may be there.
            Dtype::F32 => {
                let numbers = view.data().as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b));
                for number in numbers {
                    assert!((-1.0..=1.0).contains(&number), "`{name}` has {number}, which is no action");
                    for state in &states {
                        let forms = [*state, state / 40.0, state / 38.5, state / 3.0, (state - 20.0) / 18.5];
                        assert!(forms.iter().all(|form| *form as f32 != number), "`{name}` has the coordinate {state}");
                    }
                }
            }
            Dtype::U8 => assert!(view.data().iter().all(|&p| p == 0 || p == 255), "`{name}` is no picture"),
            Dtype::U32 => {
                assert!(view.data().as_chunks::<4>().0.iter().all(|b| u32::from_le_bytes(*b) < 3), "`{name}`")
            }
            other => panic!("`{name}` holds {other:?}"),
        }
    }
}

#[test]
fn stages_that_meet_the_world_hand_on_transitions_of_the_documented_form() {
    let chain = stages::Chain::run();
    for files in [&chain.bootstrap, &chain.collected] {
        let names: Vec<_> = tensors(&files.bytes("transitions.safetensors").expect("a file"))
            .into_iter()
            .map(|(name, _)| name)
            .collect();
        assert_eq!((names.len(), files.len()), (5, 1));
        assert_eq!(names, ["actions", "goal_index", "goals", "next_observations", "observations"]);
    }
    for files in [&chain.model, &chain.agent, &chain.distilled] {
        for (name, _) in files
            .iter()
            .filter(|(name, _)| name.ends_with(".safetensors"))
            .flat_map(|(_, b)| tensors(&b.bytes().expect("bytes")))
        {
            let parts = ["weight", "bias", "background", "log_alpha", "log_alpha/m", "log_alpha/v"];
            let whitening = ["whitening/mean", "whitening/inverse"];
            let is_known =
                parts.iter().chain(&whitening).any(|part| name == *part || name.ends_with(&format!(".{part}")));
            assert!(is_known, "`{name}` is not documented");
        }
    }
}

/// Where an episode stands holds true states. It lies in a file of its own, and what learns does not notice what is in it.
#[test]
fn training_does_not_notice_where_the_last_episode_stands() {
    let chain = stages::Chain::run();
    let learned: &stages::Inputs<'_> =
        &[("model", &[&chain.model]), ("agent", &[&chain.agent]), ("last", &[&chain.collected])];
    let collected = stages::run("collect", json!({ "samples": 30, "continue": true }), learned);
    assert_eq!(collected.names().collect::<Vec<_>>(), ["standing.json", "transitions.safetensors"]);
    let mut lies = collected.clone();
    let standing = json!({ "before": [9, 9], "state": [9, 9], "goal": 0, "steps": 1 });
    lies.insert("standing.json", serde_json::to_vec(&standing).expect("JSON"));
    assert_ne!(Collected::load(&lies).expect("files"), Collected::load(&collected).expect("files"));
    assert_eq!(Transitions::load(&lies).expect("files"), Transitions::load(&collected).expect("files"));
    assert_eq!(train(&lies), train(&collected));
    // Only a collection asks for the type that has it.
    for kind in stage::registry() {
        let asks = kind.ports.iter().any(|port| port.artifact == Collected::TYPE);
        assert_eq!(asks, kind.name == "collect", "{}", kind.name);
    }
}

/// Fails to compile when one of these grows a field: then say here why no state is in it.
#[test]
fn what_training_reads_has_no_room_for_a_state() {
    let (transitions, _) = transitions(&PLANAR, 1);
    let Transitions {
        picture: _,
        action_dim: _,
        observations: _,
        actions: _,
        next_observations: _,
        goals: _,
        goal_index: _,
    } = transitions;
    let _data = |Data { images: _, actions: _, action_dim: _, copies: _ }: Data| ();
    let _codes = |Codes { data: _, actions: _, goals: _ }: Codes| ();
}

/// Evaluations, latent maps and collections hold true states, so no kind that learns may take them. Evaluations may be
/// summed up, into an artifact that no kind takes. A collection may go on from an earlier one.
#[test]
fn no_kind_takes_what_holds_states() {
    for kind in stage::registry() {
        for port in kind.ports {
            let sums_up = (kind.output, port.artifact) == ("summary", "evaluation");
            let goes_on = (kind.output, port.artifact) == ("collection", "collection");
            let stateless = [
                "transitions",
                "encoder",
                "lce_model",
                "agent",
                "ilqr",
                "trajectories",
                "solar_model",
                "solar_controller",
            ];
            let holds_no_state = stateless.contains(&port.artifact);
            let may_enter = sums_up || goes_on || holds_no_state;
            assert!(may_enter, "{} takes {} by its port {}", kind.name, port.artifact, port.name);
        }
    }
}

#[test]
fn the_probe_of_latent_maps_gives_nothing_back() {
    let (data, _) = transitions(&PLANAR, 10);
    let (model, _) = train(&data.save().expect("files"));
    let model = TrainedModel::load(&model).expect("a model").model;
    let (task, mut record, mut off) = (stages::planar(), Recorder::off(), Recorder::off());
    let threads = carl_pipe::num::Threads::new(1);
    let cx = stage::StageCx::new(&mut record, &task, stages::stream("train_lce"), 0, threads, &stages::Quiet);
    // The type is the test: a stage that trains can have its map recorded, and learns nothing from it.
    let () = cx.map_probe().record(&model, &mut off, At::new(0, 0, 0));
}
