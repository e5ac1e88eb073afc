//! Artifacts survive the disk to the byte, and files that are damaged or foreign are refused in words.

use crate::support::{
    mutated::{any_bytes, corpus, modestly, mutation},
    stages,
};
use std::{
    panic::{AssertUnwindSafe, catch_unwind},
    sync::LazyLock,
};

use carl_pipe::{
    artifact::{
        Artifact, Codes, Collected, Evaluation, Files, LatentMap, MetricSummary, ResultSummary, TrainedModel,
        Trajectories, Transitions,
    },
    control::{Agent, Ilqr, agent::Whitening},
    env::{Planar, System as _},
    lce::{BackwardSizes, ImageNetworks, LceModel, PassiveDynamics, Sizes},
    nn::adam::Adam,
    num::{rng::Rng, stats::Summary},
    solar::{LinearGaussianPolicy, Small, SolarController, SolarModel, controller::Plan},
};
use proptest::prelude::*;
use rand::SeedableRng as _;
use serde_json::{Value, json};

/// A type of artifact with its types erased.
#[derive(Clone, Copy)]
struct Kind {
    name: &'static str,
    /// Other types that can be read from the same files.
    readable_as: &'static [&'static str],
    /// Loads and saves again.
    again: fn(&Files) -> anyhow::Result<Files>,
}

fn kind<A: Artifact>() -> Kind {
    Kind { name: A::TYPE, readable_as: A::READABLE_AS, again: |files| A::load(files)?.save() }
}

fn transitions() -> Transitions {
    let planar = Planar { noise: 0.0 };
    let mut transitions =
        Transitions { picture: planar.frames().observation(), action_dim: 2, ..Transitions::default() };
    for goal in planar.goals() {
        transitions.goals.extend(planar.observe_at_rest(&goal));
    }
    for step in 0..5_u32 {
        let [now, next] = [step, step + 1].map(|i| planar.observe_at_rest(&[3.0 + f64::from(i), 4.0]));
        transitions.push(&now, &[0.5, f32::from_bits(step)], &next, step % 3);
    }
    transitions
}

fn model() -> TrainedModel {
    let sizes = Sizes {
        shades: None,
        jacobian_heads: true,
        locally_linear: false,
        passive_dynamics: PassiveDynamics::None,
        images: ImageNetworks::Dense,
        pixels: 6,
        latent: 2,
        action: 1,
        encoder: [3, 4],
        decoder: [4, 3],
        dynamics: [3, 3],
        backward: BackwardSizes { z: 1, u: 2, x: 3, joint: 4 },
    };
    let mut rng = Rng::seed_from_u64(1);
    let model = LceModel::new(sizes, vec![0, 1, 1, 0, 0, 0], &mut rng);
    let [m, v] = [(); 2].map(|()| model.nets.layout.initialize(&mut rng));
    TrainedModel { model, adam: Adam { m, v, steps: u64::MAX }, suspect_goals: vec![0, 2] }
}

fn agent() -> Agent {
    let whitening = Some(Whitening { mean: vec![0.25, -1.5], inverse: vec![f32::MIN_POSITIVE, 1e30] });
    let mut agent = Agent::new(2, 2, whitening, -0.3, &mut Rng::seed_from_u64(2));
    agent.critics[1].adam.steps = 7;
    agent.actor.adam.m[3] = -0.0;
    agent
}

fn evaluation() -> Evaluation {
    let json = json!({
        "percent_goal": 12.195121951219512, "policy_alone": 0.1 + 0.2, "percent_goal_t": 1e-300, "share_of_ceiling": 15.4,
        "unstick": "random", "radius": 5.0, "horizon": 40,
        "episodes": [{ "goal": 2, "percent_goal": 12.5, "policy_alone": 0.0, "path": [[3.5, 38.5], [1.5, 4.25]] }],
    });
    serde_json::from_value(json).expect("an evaluation")
}

fn ilqr() -> Ilqr {
    Ilqr { state_cost: 0.1, plan_length: 7, ..Ilqr::default() }
}

fn map() -> LatentMap {
    let codes = Codes { latent: 2, states: vec![0.0, 1.0, 0.5, -1.0, 2.0, 0.25], goals: vec![1.0, 1.0] };
    LatentMap::new(vec![[0, 0], [0, 1], [1, 0]], vec![[0.1, 0.1], [0.1, 0.2], [0.2, 0.1]], codes, 0.75)
}

fn summary() -> ResultSummary {
    let models = vec![76.8, 77.3];
    let metric = || MetricSummary { summary: Summary::of(&models).expect("models"), models: models.clone() };
    let Evaluation { controller, radius, start, horizon, .. } = evaluation();
    ResultSummary {
        controller,
        radius,
        start,
        horizon,
        episodes: vec![10, 10],
        percent_goal: metric(),
        policy_alone: metric(),
        percent_goal_t: metric(),
        ceiling: Some(78.87),
        share_of_ceiling: Some(97.7),
    }
}

fn trajectories() -> Trajectories {
    let Transitions { picture, observations, actions, goals, .. } = transitions();
    let mut made = Trajectories { picture, action_dim: 2, observations, actions, goals, ..Trajectories::default() };
    made.costs = vec![0.5, -0.0, 1e30, f32::MIN_POSITIVE, 3.0];
    made.end_episode(2);
    made
}

fn solar_model() -> SolarModel {
    SolarModel::new(model().model.sizes, vec![0; 6], 3, None, &mut Rng::seed_from_u64(5))
}

fn solar_controller() -> SolarController {
    let model = solar_model();
    let dynamics: Vec<_> = model.dynamics.iter().map(|n| n.mniw().unwrap().expected().unwrap()).collect();
    let mut policy = LinearGaussianPolicy::random(4, 2, &[0.5]);
    policy.steps[3].gain = Small::from_rows(1, 2, &[1.5, f64::MIN_POSITIVE]);
    SolarController { networks: model.networks, plans: vec![Plan { policy, dynamics }; 3] }
}

fn all() -> Vec<(Kind, Files)> {
    vec![
        (kind::<Trajectories>(), trajectories().save().expect("files")),
        (kind::<SolarModel>(), solar_model().save().expect("files")),
        (kind::<SolarController>(), solar_controller().save().expect("files")),
        (kind::<Transitions>(), transitions().save().expect("files")),
        (kind::<TrainedModel>(), model().save().expect("files")),
        (kind::<Agent>(), agent().save().expect("files")),
        (kind::<Ilqr>(), ilqr().save().expect("files")),
        (kind::<Evaluation>(), evaluation().save().expect("files")),
        (kind::<LatentMap>(), map().save().expect("files")),
        (kind::<ResultSummary>(), summary().save().expect("files")),
    ]
}

/// Loads and saves; a panic fails the test in the name of `what`.
fn again(kind: Kind, files: &Files, what: &str) -> anyhow::Result<Files> {
    catch_unwind(AssertUnwindSafe(|| (kind.again)(files))).unwrap_or_else(|_| panic!("{}: {what} panics", kind.name))
}

#[track_caller]
fn refused(kind: Kind, files: &Files, what: &str) {
    let refusal = again(kind, files, what).expect_err(&format!("{}: {what} is not refused", kind.name));
    assert!(!format!("{refusal:#}").is_empty());
}

#[test]
fn values_survive_the_disk() {
    fn survives<A: Artifact + Clone + PartialEq + std::fmt::Debug>(value: &A) {
        assert!(A::load(&value.clone().save().expect("files")).expect("readable") == *value, "{}", A::TYPE);
    }
    survives(&transitions());
    survives(&model());
    let mut drifting = model();
    drifting.set_passive_dynamics(PassiveDynamics::Quadratic);
    survives(&drifting);
    survives(&agent());
    survives(&evaluation());
    survives(&ilqr());
    survives(&map());
    survives(&summary());
    survives(&trajectories());
    survives(&solar_model());
    survives(&solar_controller());
}

#[test]
fn saving_what_was_loaded_gives_equal_bytes() {
    for (kind, files) in all() {
        assert!(again(kind, &files, "its own files").expect("readable") == files, "{}", kind.name);
    }
}

#[test]
fn saving_what_stages_made_gives_equal_bytes() {
    let chain = stages::Chain::run();
    for (name, maker, _, files) in chain.all() {
        let output = carl_pipe::stage::kind(maker).expect("a kind").output;
        let collected = std::iter::once(kind::<Collected>());
        let mut kinds = all().into_iter().map(|(kind, _)| kind).chain(collected);
        let kind = kinds.find(|kind| kind.name == output).expect("known");
        assert!(again(kind, files, name).expect("readable") == *files, "{name}");
    }
}

#[test]
fn a_missing_file_is_refused_by_name() {
    for (kind, files) in all() {
        for name in files.names().filter(|name| !name.ends_with(".svg")) {
            let mut fewer = files.clone();
            fewer.remove(name);
            let error = again(kind, &fewer, name).expect_err("refused");
            assert!(format!("{error:#}").contains(name), "{}: {error:#}", kind.name);
        }
    }
}

#[test]
fn a_truncated_file_is_refused_wherever_it_ends() {
    for (kind, files) in all() {
        for (name, content) in files.iter().filter(|(name, _)| !name.ends_with(".svg")) {
            let bytes = content.bytes().expect("bytes");
            let header = 400.min(bytes.len());
            // The last byte of a JSON file is a line break, without which it is as good.
            let whole = bytes.len() - usize::from(name.ends_with(".json"));
            let ends = (0..header).step_by(7).chain((header..whole).step_by(whole / 23 + 1)).chain([whole - 1]);
            for end in ends {
                let mut cut = files.clone();
                cut.insert(name, bytes[..end].to_vec());
                refused(kind, &cut, &format!("`{name}` cut after {end} bytes"));
            }
        }
    }
}

#[test]
fn a_changed_byte_of_a_header_never_panics() {
    for (kind, files) in all() {
        for (name, content) in files.iter() {
            let bytes = content.bytes().expect("bytes");
            for at in (0..bytes.len().min(1200)).step_by(5) {
                for flip in [0x01, 0x08, 0xff] {
                    let (mut changed, mut bytes) = (files.clone(), bytes.to_vec());
                    bytes[at] ^= flip;
                    changed.insert(name, bytes);
                    // A changed number may well be a valid value; what counts is that nothing panics.
                    drop(again(kind, &changed, &format!("`{name}` with byte {at} changed")));
                }
            }
        }
    }
}

#[test]
fn files_of_another_artifact_are_refused() {
    let all = all();
    for (kind, own) in &all {
        let is_foreign = |other: &Kind| other.name != kind.name && !other.readable_as.contains(&kind.name);
        for (other, foreign) in all.iter().filter(|(other, _)| is_foreign(other)) {
            refused(*kind, foreign, other.name);
            // The same files under the names that this artifact has.
            let contents: Vec<_> = foreign.iter().map(|(_, content)| content.clone()).collect();
            let renamed: Files = own.names().zip(contents.into_iter().cycle()).collect();
            refused(*kind, &renamed, &format!("{} under its own names", other.name));
        }
    }
}

/// Changes a field of a JSON file.
fn with(files: &Files, name: &str, pointer: &str, value: Value) -> Files {
    let mut json: Value = serde_json::from_slice(&files.bytes(name).expect("a file")).expect("JSON");
    *json.pointer_mut(pointer).expect("a field") = value;
    let mut files = files.clone();
    files.insert(name.to_owned(), serde_json::to_vec(&json).expect("JSON"));
    files
}

#[test]
fn widths_that_do_not_fit_the_tensors_are_refused() {
    let (model, agent, map) =
        (model().save().expect("files"), agent().save().expect("files"), map().save().expect("files"));
    for width in [json!(0), json!(9), json!(5_000_000), json!(1_u64 << 40), json!(u64::MAX), json!(-1), json!(0.5)] {
        for field in ["pixels", "latent", "action", "encoder/1", "decoder/1", "dynamics/1", "backward/0"] {
            let files = with(&model, "model.json", &format!("/sizes/{field}"), width.clone());
            refused(kind::<TrainedModel>(), &files, &format!("{field} of {width}"));
        }
        for field in ["latent", "action"] {
            let files = with(&agent, "agent.json", &format!("/{field}"), width.clone());
            refused(kind::<Agent>(), &files, &format!("{field} of {width}"));
        }
        refused(
            kind::<LatentMap>(),
            &with(&map, "latent_map.json", "/latent", width.clone()),
            &format!("latent of {width}"),
        );
    }
}

#[test]
fn transitions_of_different_lengths_are_refused() {
    let whole = transitions();
    for (what, change) in [
        ("an action less", (|t| t.actions.truncate(8)) as fn(&mut Transitions)),
        ("a next observation less", |t| t.next_observations.truncate(4 * 1600)),
        ("an observation less", |t| t.observations.truncate(4 * 1600)),
        ("half an observation less", |t| t.observations.truncate(800)),
        ("no goal images", |t| t.goals.clear()),
        ("a goal without an image", |t| t.goal_index[2] = 3),
    ] {
        let mut changed = whole.clone();
        change(&mut changed);
        let refused = changed.save().and_then(|files| Transitions::load(&files));
        assert!(refused.is_err(), "{what}");
    }
}

#[test]
fn transitions_of_different_tasks_are_not_joined() {
    let one = transitions();
    let other = Transitions { goals: one.goals[..2 * 1600].to_vec(), ..one.clone() };
    assert!(Transitions::concat(&[one.clone(), other]).is_err());
    let both = Transitions::concat(&[one.clone(), one.clone()]).expect("of one task");
    assert_eq!((both.len(), &both.goals), (10, &one.goals));
}

/// A file of an artifact, with the kind and all files of the artifact.
type OneFile = (Kind, Files, String);

/// Every file of every artifact.
fn every_file() -> &'static [OneFile] {
    static FILES: LazyLock<Vec<OneFile>> = LazyLock::new(|| {
        let one_by_one = |(kind, files): (Kind, Files)| {
            let names: Vec<String> = files.names().filter(|name| !name.ends_with(".svg")).map(str::to_owned).collect();
            names.into_iter().map(move |name| (kind, files.clone(), name))
        };
        all().into_iter().flat_map(one_by_one).collect()
    });
    &FILES
}

/// Whether bytes are a file of its kind at all, in the judgement of the libraries.
fn is_well_formed(name: &str, bytes: &[u8]) -> bool {
    match name.ends_with(".json") {
        true => serde_json::from_slice::<Value>(bytes).is_ok(),
        // The library adds lengths from the file without a check.
        false => catch_unwind(|| safetensors::SafeTensors::deserialize(bytes).is_ok()).unwrap_or(false),
    }
}

/// Loads an artifact with one file replaced. The error names a file that is malformed.
fn load_with((kind, files, name): &OneFile, bytes: &[u8]) -> bool {
    let mut files = files.clone();
    files.insert(name.clone(), bytes.to_vec());
    let loaded = modestly(bytes, |_| again(*kind, &files, name));
    if let Err(error) = &loaded {
        let text = format!("{error:#}");
        assert!(text.contains(name.as_str()) || is_well_formed(name, bytes), "{}: {text}", kind.name);
    }
    loaded.is_ok()
}

#[test]
fn the_corpus_of_tensors_is_read_or_refused() {
    let transitions = (kind::<Transitions>(), Files::new(), "transitions.safetensors".to_owned());
    for (path, bytes, is_whole) in corpus("tensors") {
        assert_eq!(load_with(&transitions, &bytes), is_whole, "{}", path.display());
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn arbitrary_bytes(bytes in any_bytes(), file in 0..every_file().len()) {
        prop_assert!(!load_with(&every_file()[file], &bytes));
    }

    #[test]
    fn an_artifact_with_any_change_to_a_file(mutation in mutation()) {
        let (file, bytes) = mutation.of(every_file(), |(_, files, name)| files.bytes(name).unwrap().into_owned());
        load_with(file, &bytes);
    }
}
