//! Kills the program, and lets the system fail, at every failpoint (`src/failpoint.rs`). The same command then finishes,
//! nothing that was finished is made again, every byte is the same as without the fault, and nothing is left over.
//!
//! A new failpoint is tried without a change here. Where a point is reached several times, the process is killed at the first
//! and at the last, and one error comes in the middle. `FAULTS=all` tries every error and a kill each time.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs, io,
    os::unix::{fs::symlink, process::ExitStatusExt as _},
    panic::catch_unwind,
    path::{Path, PathBuf},
    process::Output,
};

use crate::support::{
    cli::{Ended, Toy, digests, times_run},
    run::damage,
};
use carl_pipe::failpoint::POINTS;
use rayon::prelude::*;
use serde_json::Value;

/// Three nodes, one after the other.
const RUN: &str = "run toy.toml -j1 --json -S rounds=1 -S data.steps=1 -S learn.steps=1 -S evaluate.steps=1 --note one";

/// A command that meets a fault.
struct Scene {
    /// Makes the store in this folder, and returns the command.
    prepare: fn(&Stage<'_>) -> String,
    /// The command after the fault, if it is not the same one.
    again: Option<&'static str>,
}

const SCENES: &[Scene] = &[
    Scene { prepare: |_| RUN.to_owned(), again: None },
    Scene { prepare: a_run_over_damage, again: None },
    Scene { prepare: a_forced_run, again: Some(RUN) },
    Scene { prepare: a_repair, again: None },
    Scene { prepare: a_cleaning, again: None },
    Scene { prepare: a_cleaning_of_the_newest_run, again: Some("gc --yes") },
    Scene { prepare: a_tag, again: None },
    Scene { prepare: a_replay, again: None },
];

fn a_run_over_damage(stage: &Stage<'_>) -> String {
    stage.succeed(RUN);
    damage(&stage.linked("evaluate@0.value.json"));
    RUN.to_owned()
}

fn a_forced_run(stage: &Stage<'_>) -> String {
    stage.succeed(RUN);
    format!("{RUN} --force")
}

fn a_repair(stage: &Stage<'_>) -> String {
    stage.succeed(RUN);
    damage(&stage.linked("evaluate@0.value.json"));
    damage(&stage.linked("learn@0.mcap"));
    "verify --repair -j1".to_owned()
}

fn a_cleaning(stage: &Stage<'_>) -> String {
    stage.succeed(&format!("{RUN} -S data.plus=7"));
    stage.succeed(RUN);
    fs::write(stage.store.join("tmp/carl-tmp-left"), "half").unwrap();
    "gc --keep 1 --yes".to_owned()
}

fn a_cleaning_of_the_newest_run(stage: &Stage<'_>) -> String {
    stage.succeed(RUN);
    stage.succeed(&format!("{RUN} -S data.plus=7"));
    "gc --drop latest --yes".to_owned()
}

fn a_tag(stage: &Stage<'_>) -> String {
    stage.succeed(RUN);
    "tag latest good".to_owned()
}

fn a_replay(stage: &Stage<'_>) -> String {
    stage.succeed(RUN);
    "replay latest -j1".to_owned()
}

/// A store to run commands on.
struct Stage<'a> {
    toy: &'a Toy,
    store: PathBuf,
}

impl Stage<'_> {
    fn output(&self, words: &str, env: &[(&str, &str)]) -> Output {
        let store = self.store.file_name().unwrap().to_str().unwrap();
        self.toy.command(&format!("--artifacts {store} {words}")).envs(env.iter().copied()).output().unwrap()
    }

    fn run(&self, words: &str) -> Ended {
        Ended::of(self.output(words, &[]))
    }

    fn succeed(&self, words: &str) -> Ended {
        let ended = self.run(words);
        assert_eq!(ended.code, Some(0), "{words}: {ended:?}");
        ended
    }

    /// The file of the store that a name in the newest run leads to.
    fn linked(&self, name: &str) -> PathBuf {
        fs::canonicalize(self.store.join("runs/latest").join(name)).unwrap()
    }

    /// The same store in another folder.
    fn copy(&self, name: &str) -> Self {
        let copy = Stage { toy: self.toy, store: self.toy.path(name) };
        if self.store.exists() {
            copy_folder(&self.store, &copy.store);
        }
        copy
    }
}

fn copy_folder(from: &Path, to: &Path) {
    fs::create_dir(to).unwrap();
    for item in fs::read_dir(from).unwrap().map(Result::unwrap) {
        let (path, copy) = (item.path(), to.join(item.file_name()));
        match item.file_type().unwrap() {
            kind if kind.is_dir() => copy_folder(&path, &copy),
            kind if kind.is_symlink() => symlink(fs::read_link(&path).unwrap(), copy).unwrap(),
            _ => _ = fs::copy(&path, copy).unwrap(),
        }
    }
}

/// What happens where.
#[derive(Debug, Clone)]
struct Fault {
    scene: usize,
    point: String,
    nth: usize,
    /// The number of the system's error; `None` for a kill.
    error: Option<i32>,
}

/// What a scene does without a fault.
struct Undisturbed {
    command: String,
    outputs: BTreeMap<String, (Value, Value)>,
    times: BTreeMap<String, usize>,
    /// How often each point is reached.
    points: BTreeMap<String, usize>,
}

fn undisturbed(stage: &Stage<'_>, command: String) -> Undisturbed {
    let trace = stage.store.with_extension("trace");
    let copy = stage.copy(&format!("{}-undisturbed", stage.store.file_name().unwrap().to_string_lossy()));
    let output = copy.output(&command, &[("CARL_FAILPOINT_TRACE", trace.to_str().unwrap())]);
    assert_eq!(output.status.code(), Some(0), "{command}: {output:?}");
    let mut points = BTreeMap::<_, usize>::new();
    for point in fs::read_to_string(trace).unwrap().lines() {
        *points.entry(point.to_owned()).or_default() += 1;
    }
    let outputs = digests(&copy.succeed(RUN).json());
    // A cleaning also takes the events of the runs that go.
    let mut times = times_run(&copy.store);
    if stage.store.exists() {
        times_run(&stage.store)
            .into_iter()
            .for_each(|(node, before)| _ = times.entry(node).and_modify(|now| *now = before.max(*now)));
    }
    Undisturbed { command, outputs, times, points }
}

/// Not enough room, a broken disk, an interrupted call, too many open files: `ENOSPC`, `EIO`, `EINTR`, `EMFILE`.
const ERRORS: [i32; 4] = [28, 5, 4, 24];

fn faults(scenes: &[Undisturbed]) -> Vec<Fault> {
    let is_all = std::env::var("FAULTS").is_ok_and(|it| it == "all");
    let mut faults = Vec::new();
    for (scene, Undisturbed { points, .. }) in scenes.iter().enumerate() {
        for (number, (point, &times)) in points.iter().enumerate() {
            let fault = |nth, error| Fault { scene, point: point.clone(), nth, error };
            if is_all {
                for nth in 1..=times {
                    faults.push(fault(nth, None));
                    faults.extend(ERRORS.map(|error| fault(nth, Some(error))));
                }
            } else {
                faults.extend(BTreeSet::from([1, times]).into_iter().map(|nth| fault(nth, None)));
                faults.push(fault(times.div_ceil(2), Some(ERRORS[(scene + number) % ERRORS.len()])));
            }
        }
    }
    faults
}

#[test]
fn a_fault_at_any_point_loses_nothing_and_the_same_command_goes_on() {
    let toy = Toy::new();
    let prepared: Vec<Stage<'_>> =
        (0..SCENES.len()).map(|scene| Stage { toy: &toy, store: toy.path(&format!("scene-{scene}")) }).collect();
    let scenes: Vec<Undisturbed> =
        SCENES.par_iter().zip(&prepared).map(|(scene, stage)| undisturbed(stage, (scene.prepare)(stage))).collect();
    let reached: BTreeSet<&str> = scenes.iter().flat_map(|scene| scene.points.keys()).map(String::as_str).collect();
    let missed: Vec<_> = POINTS.iter().filter(|point| !reached.contains(*point)).collect();
    assert!(missed.is_empty(), "no scene reaches these failpoints: {missed:?}");
    let faults = faults(&scenes);
    let is_lost = |(number, fault): (usize, &Fault)| {
        let stage = prepared[fault.scene].copy(&format!("fault-{number}"));
        let ended = catch_unwind(|| survives(&stage, fault, &scenes[fault.scene]));
        fs::remove_dir_all(&stage.store).unwrap();
        ended.is_err()
    };
    let lost = faults.par_iter().enumerate().filter(|&it| is_lost(it)).count();
    assert_eq!(lost, 0, "of {} faults at {} points", faults.len(), reached.len());
    eprintln!("{} faults at {} points", faults.len(), reached.len());
}

fn survives(stage: &Stage<'_>, fault: &Fault, undisturbed: &Undisturbed) {
    let Undisturbed { command, outputs, times, .. } = undisturbed;
    let Fault { scene, point, nth, error } = fault;
    let what = error.map_or("kill".to_owned(), |error| error.to_string());
    let output = stage.output(command, &[("CARL_FAILPOINT", &format!("{point}@{nth}={what}"))]);
    match error {
        None => assert_eq!(output.status.signal(), Some(6), "{fault:?}: {output:?}"),
        Some(error) => is_told(stage, fault, *error, &Ended::of(output)),
    }
    let again = stage.run(SCENES[*scene].again.unwrap_or(command));
    assert_eq!(again.code, Some(0), "{fault:?}: {again:?}");
    let last = digests(&stage.succeed(RUN).json());
    for (node, (output, recording)) in outputs {
        let (now, recorded) = &last[node];
        assert_eq!(now, output, "{fault:?}: {node}");
        // A recording that failed was told; `verify --repair` makes it below.
        assert!(recorded == recording || (recorded.is_null() && error.is_some()), "{fault:?}: {node}");
    }
    for (node, times_now) in times_run(&stage.store) {
        assert!(times_now <= times[&node], "{fault:?}: {node} ran again although finished");
    }
    stage.succeed("verify --repair");
    assert_eq!(&digests(&stage.succeed(RUN).json()), outputs, "{fault:?}");
    stage.succeed("gc --yes");
    assert_eq!(strays(&stage.store), Vec::<PathBuf>::new(), "{fault:?}");
}

/// An error ends the command with its cause and its place, or is told in a warning, or costs nothing.
fn is_told(stage: &Stage<'_>, fault: &Fault, error: i32, ended: &Ended) {
    let cause = io::Error::from_raw_os_error(error).to_string();
    let cause = cause.split(" (os error").next().unwrap();
    assert!(ended.code.is_some_and(|code| [0, 4, 5, 7].contains(&code)), "{fault:?}: {ended:?}");
    let text = format!("{}{}", ended.out, ended.err);
    assert!(!text.contains("panicked") && !text.contains("mistake in carl-pipe"), "{fault:?}: {ended:?}");
    let is_told = text.lines().any(|line| line.contains(cause) && line.contains("fault-"));
    let is_harmless = || ended.code == Some(0) && stage.run("verify").code == Some(0);
    let is_untouched = ended.code == Some(7) && text.contains("nothing was removed");
    assert!(is_told || is_untouched || is_harmless(), "{fault:?}: {ended:?}");
}

/// What a cleaning should have removed.
fn strays(store: &Path) -> Vec<PathBuf> {
    let items = |folder: &Path| fs::read_dir(folder).unwrap().map(|item| item.unwrap().path()).collect::<Vec<_>>();
    let is_temporary = |path: &PathBuf| path.file_name().unwrap().to_string_lossy().starts_with("carl-tmp-");
    let mut runs = items(&store.join("runs"));
    runs.retain(|path| !path.ends_with("numbers"));
    let is_whole =
        |path: &PathBuf| path.join("alive").exists() && !path.file_name().unwrap().as_encoded_bytes().starts_with(b".");
    let is_run = |path: &&PathBuf| path.ends_with("latest") || is_whole(path);
    let mut strays: Vec<PathBuf> = runs.iter().filter(|path| !is_run(path)).cloned().collect();
    strays.extend(["tmp", "bad", "locks"].iter().flat_map(|folder| items(&store.join(folder))));
    let may_hold = runs.iter().filter(is_run).cloned().chain([store.to_owned(), store.join("runs")]);
    strays.extend(may_hold.flat_map(|folder| items(&folder)).filter(is_temporary));
    strays
}
