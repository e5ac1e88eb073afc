//! Each symmetry that a task declares gives transitions of the task, and training changes the transitions that it is asked to.

use carl_pipe::{
    artifact::{Artifact as _, Files, Transitions},
    env::{self, Frames, SeenTransition, Symmetry, System, Task},
    num::{Threads, rng::Rng, sampling},
    record::Recorder,
    stage::{StageCx, Symmetries},
};
use rand::SeedableRng as _;
use serde_json::{Value, json};

use crate::support::stages;

fn read(table: &Value) -> Task {
    serde_json::from_value(table.clone()).expect("a task")
}

/// What a symmetry must do, for its proof.
struct Claim {
    /// Its operation on true states, by how many columns it moves the pictures.
    on_states: fn(&[f64], isize) -> Vec<f64>,
    /// The most columns that it moves pictures by.
    reach: isize,
    /// The share of the lit pixels that may differ.
    differ: f64,
}

fn claim(task: &str, symmetry: &str) -> Option<Claim> {
    let mirror = |differ| {
        let on_states = |state: &[f64], _| state.iter().map(|number| -number).collect();
        Some(Claim { on_states, reach: 0, differ })
    };
    match (task, symmetry) {
        // The pole is 4 pixels wide, and no column is its middle.
        ("swing_up", "mirror") => mirror(0.5),
        ("cart_pole", "mirror") => mirror(0.2),
        ("three_pole", "mirror") => mirror(0.1),
        ("cart_pole", "shift") => {
            // 32 columns show 2.4 m.
            let on_states = |state: &[f64], columns| {
                let moved = state[2] + columns as f64 * 2.4 / 32.0;
                vec![state[0], state[1], moved, state[3]]
            };
            Some(Claim { on_states, reach: 64, differ: 0.01 })
        }
        _ => None,
    }
}

/// The states of a transition, and its action as shares of the limits.
struct True {
    before: Vec<f64>,
    now: Vec<f64>,
    next: Vec<f64>,
    action: Vec<f32>,
}

impl True {
    fn from(system: &dyn System, before: Vec<f64>, now: Vec<f64>, action: Vec<f32>) -> Self {
        let in_units: Vec<f64> =
            action.iter().zip(system.action_limit()).map(|(&u, limit)| f64::from(u) * limit).collect();
        let next = system.step(&now, &in_units, &mut Rng::seed_from_u64(0));
        Self { before, now, next, action }
    }

    fn random(system: &dyn System, rng: &mut Rng) -> Self {
        let before = system.sample_state(rng).expect("a state");
        let now = system.step(&before, &system.sample_action(rng), rng);
        let action = system.action_limit().iter().map(|_| sampling::uniform(rng, -1.0, 1.0)).collect();
        Self::from(system, before, now, action)
    }

    fn pictures(&self, system: &dyn System) -> Vec<u8> {
        [system.observe(&self.before, &self.now), system.observe(&self.now, &self.next)].concat()
    }
}

/// Pixels that differ; `None` where one of them has no pixel of its value within two pixels of it in the other picture. What
/// is outside of a frame may have any value.
fn rounding(got: &[u8], want: &[u8], Frames { height, width, .. }: Frames) -> Option<usize> {
    const REACH: usize = 2;
    let mut differ = 0;
    for (got, want) in got.chunks(height * width).zip(want.chunks(height * width)) {
        for at in (0..got.len()).filter(|&at| got[at] != want[at]) {
            let around = |place: usize, count: usize| {
                let is_inside = place >= REACH && place + REACH < count;
                is_inside.then(|| place - REACH..=place + REACH)
            };
            if let (Some(rows), Some(columns)) = (around(at / width, height), around(at % width, width)) {
                let mut near = rows.flat_map(|row| columns.clone().map(move |column| row * width + column));
                near.find(|&near| want[near] == got[at])?;
            }
            differ += 1;
        }
    }
    Some(differ)
}

/// Proves a symmetry at random transitions: the dynamics take the changed states, under the changed action, where the
/// changed next state is, and the pictures of that transition are the changed pictures.
fn prove(task: &Task, symmetry: &Symmetry, claim: &Claim) -> Result<(), String> {
    let (system, mut rng) = (task.system().expect("equations"), Rng::seed_from_u64(7));
    let (system, frames) = (&*system, system.frames());
    let (mut lit, mut differ) = (0, 0);
    for _ in 0..60 {
        let transition = True::random(system, &mut rng);
        let (mut pictures, mut action) = (transition.pictures(system), transition.action.clone());
        (symmetry.apply)(&mut SeenTransition { pictures: &mut pictures, action: &mut action, frames }, &mut rng);
        let changed = |columns: isize| {
            let [before, now, next] =
                [&transition.before, &transition.now, &transition.next].map(|state| (claim.on_states)(state, columns));
            let changed = True::from(system, before, now, action.clone());
            // The steps of the integrator depend on the state.
            let is_one = changed.next.iter().zip(&next).all(|(a, b)| (a - b).abs() < 1e-5);
            is_one.then(|| changed.pictures(system)).ok_or_else(|| format!("{next:?} is {:?}", changed.next))
        };
        let mut fewest = None;
        for columns in -claim.reach..=claim.reach {
            let one = rounding(&pictures, &changed(columns)?, frames);
            fewest = fewest.into_iter().chain(one).min();
        }
        differ += fewest.ok_or_else(|| format!("the pictures of {:?} are further off", transition.now))?;
        lit += pictures.iter().filter(|&&pixel| pixel != 0).count();
    }
    let share = differ as f64 / lit as f64;
    if share < claim.differ { Ok(()) } else { Err(format!("{share} of the lit pixels differ")) }
}

#[test]
fn every_symmetry_of_every_task_gives_transitions_of_the_task() {
    let mut proven = Vec::new();
    for kind in env::registry().iter().filter(|kind| !kind.symmetries.is_empty()) {
        let more = if kind.name == "three_pole" { vec![json!({ "env": kind.name, "links": 2 })] } else { vec![] };
        for task in [json!({ "env": kind.name })].iter().chain(&more).map(read) {
            for symmetry in kind.symmetries {
                let name = format!("{} of {}", symmetry.name, kind.name);
                let claim = claim(kind.name, symmetry.name);
                let claim = claim.unwrap_or_else(|| panic!("{name} has no proof: add it to `claim`"));
                prove(&task, symmetry, &claim).unwrap_or_else(|why| panic!("{name}: {why}"));
                proven.push(name);
            }
        }
    }
    proven.dedup();
    assert_eq!(proven, ["mirror of swing_up", "mirror of cart_pole", "shift of cart_pole", "mirror of three_pole"]);
}

#[test]
fn what_is_no_symmetry_is_not_proven() {
    let forgets_the_action = Symmetry { name: "mirror", about: "", apply: |seen, _| seen.mirror_columns() };
    let forgets_the_picture = Symmetry { apply: |seen, _| seen.reverse_action(), ..forgets_the_action };
    let nearly = Symmetry {
        apply: |seen, _| {
            seen.mirror_columns();
            seen.reverse_action();
            seen.shift_columns(3);
        },
        ..forgets_the_action
    };
    for env in ["swing_up", "cart_pole", "three_pole"] {
        let task = read(&json!({ "env": env }));
        for wrong in [forgets_the_action, forgets_the_picture, nearly] {
            assert!(prove(&task, &wrong, &claim(env, "mirror").expect("a claim")).is_err(), "{env}");
        }
    }
}

/// Four frames of 80 x 80 pixels with these columns lit in the row of the cart, and the columns lit after a shift.
fn shifted(columns: [std::ops::Range<usize>; 4], rng: &mut Rng) -> Vec<Vec<usize>> {
    let (row, frames) = (73, Frames::black_and_white(80, 80, 2));
    let mut pictures = vec![0; 4 * 80 * 80];
    for (frame, columns) in pictures.chunks_mut(80 * 80).zip(columns) {
        frame[row * 80..][columns].fill(255);
    }
    let kind = env::task_kind("cart_pole").expect("a task");
    let shift = kind.symmetries.iter().find(|symmetry| symmetry.name == "shift").expect("a symmetry");
    (shift.apply)(&mut SeenTransition { pictures: &mut pictures, action: &mut [0.5], frames }, rng);
    let lit = |frame: &[u8]| (0..80).filter(|column| frame[row * 80 + column] != 0).collect();
    pictures.chunks(80 * 80).map(lit).collect()
}

#[test]
fn a_shift_keeps_the_cart_in_the_picture_and_shows_nothing_that_an_edge_cut_off() {
    let mut rng = Rng::seed_from_u64(1);
    let starts = |columns: [std::ops::Range<usize>; 4], rng: &mut Rng| -> Vec<usize> {
        let mut starts: Vec<usize> = (0..2000).map(|_| shifted(columns.clone(), rng)[1][0]).collect();
        starts.sort_unstable();
        starts.dedup();
        starts
    };
    // All frames move alike, and every centre from 8 to 72 occurs.
    let lit = shifted([32..49, 33..50, 33..50, 34..51], &mut rng);
    assert_eq!([lit[1][0], lit[2][0], lit[3][0]], [1, 1, 2].map(|by| lit[0][0] + by));
    let all = |columns: std::ops::RangeInclusive<usize>| columns.collect::<Vec<_>>();
    assert_eq!(starts([32..49, 32..49, 32..49, 32..49], &mut rng), all(0..=64));
    // Column 0 is lit in one frame, then column 79, then both.
    assert_eq!(starts([0..17, 30..47, 30..47, 30..47], &mut rng), all(15..=30));
    assert_eq!(starts([63..80, 61..78, 61..78, 61..78], &mut rng), all(61..=63));
    assert_eq!(starts([0..17, 30..47, 30..47, 63..80], &mut rng), [30]);
    assert!(shifted([0..0, 0..0, 0..0, 0..0], &mut rng).iter().all(Vec::is_empty), "no cart to move");
}

/// A few transitions of a task.
fn transitions(task: &Task, samples: u64) -> Files {
    let stream = stages::stream("generate_data");
    stages::run_for(task, "generate_data", json!({ "samples": samples }), &[], stream, 1).expect("transitions")
}

#[test]
fn each_symmetry_changes_its_share_of_the_transitions_whatever_the_others_do() {
    let task = read(&json!({ "env": "cart_pole" }));
    let transitions = Transitions::load(&transitions(&task, 100)).expect("transitions");
    let mut record = Recorder::off();
    let cx = StageCx::new(&mut record, &task, stages::stream("train_lce"), 0, Threads::new(1), &stages::Quiet);
    let copies = |table: Value| {
        let symmetries: Symmetries = serde_json::from_value(table).expect("symmetries");
        let (mut pictures, mut actions) = (Vec::new(), Vec::new());
        cx.symmetric_copies(&transitions, &symmetries, 20).for_each(|both, action| {
            pictures.push(both.to_vec());
            actions.extend_from_slice(action);
        });
        (pictures, actions)
    };
    let (pictures, actions) = copies(json!({ "mirror": 0.0 }));
    assert_eq!(pictures.concat(), transitions.frames());
    assert_eq!(actions, transitions.actions);

    let frames = transitions.frames();
    let changed = |table: Value| {
        let (pictures, actions) = copies(table);
        assert_eq!((pictures.len(), actions.len()), (2000, 2000));
        let original = |at: usize| &frames[at % 100 * 2 * transitions.pixels()..][..2 * transitions.pixels()];
        let mirrored = |at: &usize| actions[*at] != transitions.actions[at % 100];
        let moved = |at: &usize| !mirrored(at) && pictures[*at] != original(*at);
        ((0..2000).filter(mirrored).count(), (0..2000).filter(moved).count())
    };
    let is_near = |count: usize, want: f64| (count as f64 - want).abs() < 100.0;
    let (mirrored, moved) = changed(json!({ "mirror": 0.5 }));
    assert!(is_near(mirrored, 1000.0) && moved == 0, "{mirrored} {moved}");
    assert_eq!(changed(json!({ "mirror": 1.0 })).0, 2000);
    // Most of the transitions can be moved.
    let (mirrored, moved) = changed(json!({ "mirror": 0.25, "shift": 0.5 }));
    assert!(is_near(mirrored, 500.0) && (400..=800).contains(&moved), "{mirrored} {moved}");
    assert_eq!(copies(json!({ "mirror": 0.5, "shift": 0.3 })), copies(json!({ "mirror": 0.5, "shift": 0.3 })));
}

#[test]
fn training_reads_the_changed_transitions_and_without_symmetries_nothing_changes() {
    let task = read(&json!({ "env": "swing_up" }));
    let data = transitions(&task, 40);
    let run = |kind: &'static str, given: Value, inputs: &stages::Inputs<'_>| {
        stages::run_for(&task, kind, given, inputs, stages::stream(kind), 1).expect("a stage that works")
    };
    let represent = |more: Value| {
        let mut given = json!({ "epochs": 2, "warm_up": { "epochs": 1, "anchor_epochs": 0 }, "ramp": { "epochs": 1 } });
        given.as_object_mut().expect("a table").extend(more.as_object().cloned().expect("a table"));
        run("train_lce", given, &[("transitions", &[&data])])
    };
    let plain = represent(json!({}));
    assert!(plain == represent(json!({ "symmetries": { "mirror": 0.0 }, "symmetric_copies": 9 })));
    assert!(plain != represent(json!({ "symmetries": { "mirror": 0.5 } })));
    let control = |more: Value| {
        let mut given = json!({ "steps": 2 });
        given.as_object_mut().expect("a table").extend(more.as_object().cloned().expect("a table"));
        run("train_sac", given, &[("transitions", &[&data]), ("model", &[&plain])])
    };
    let agent = control(json!({}));
    assert!(agent == control(json!({ "symmetries": { "mirror": 0.0 }, "symmetric_copies": 9 })));
    assert!(agent != control(json!({ "symmetries": { "mirror": 0.5 } })));
}
