//! Kills the program at random moments. The same command then finishes, no finished node runs twice, and every byte is
//! the same as without kills.
//!
//! `CHAOS_KILLS` is the number of kills, `CHAOS_ROUNDS` the length of the toy. `CHAOS_PIPELINE` names a pipeline for the real
//! program, in place of the toy, and `CHAOS_PROGRAM` another build of that program.

#![allow(clippy::disallowed_methods, reason = "tests wait and measure")]

use std::{
    path::PathBuf,
    process::{Child, Command, Stdio},
    thread::sleep,
    time::{Duration, Instant},
};

use crate::support::cli::{Ended, Toy, digests, times_run};
use rand::{RngExt as _, SeedableRng as _};
use serde_json::json;

fn number(variable: &str, otherwise: usize) -> usize {
    std::env::var(variable).ok().and_then(|text| text.parse().ok()).unwrap_or(otherwise)
}

/// The command under test, with its store in a folder of the toy's.
fn command(toy: &Toy, store: &str) -> Command {
    match std::env::var_os("CHAOS_PIPELINE") {
        None => {
            let rounds = number("CHAOS_ROUNDS", 6);
            toy.command(&format!("--artifacts {store} run toy.toml -S rounds={rounds} -j2 --json"))
        }
        Some(pipeline) => {
            let pipeline = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(pipeline);
            let program = std::env::var_os("CHAOS_PROGRAM").unwrap_or_else(|| env!("CARGO_BIN_EXE_carl-pipe").into());
            let mut command = Command::new(program);
            command.arg("run").arg(pipeline).arg("--json").arg("--artifacts").arg(toy.path(store));
            command
        }
    }
}

#[test]
fn kills_at_random_moments_lose_nothing_that_was_finished() {
    let toy = Toy::new();
    let start = Instant::now();
    let whole = Ended::of(command(&toy, "whole").output().unwrap());
    assert_eq!(whole.code, Some(0), "{whole:?}");
    let span_ms = start.elapsed().as_millis() as u64;
    let mut random = rand::rngs::ChaCha12Rng::seed_from_u64(1);
    let (kills, mut killed, mut stores) = (number("CHAOS_KILLS", 10), 0, 0);
    while killed < kills {
        stores += 1;
        let store = format!("shaken-{stores}");
        // Until a process comes through alive.
        loop {
            let mut child = command(&toy, &store).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
            sleep(Duration::from_millis(random.random_range(0..=span_ms / 3)));
            child.kill().unwrap(); // SIGKILL
            if child.wait().unwrap().success() || killed == kills {
                break;
            }
            killed += 1;
        }
        let last = Ended::of(command(&toy, &store).output().unwrap());
        assert_eq!(last.code, Some(0), "{last:?}");
        assert_eq!(digests(&last.json()), digests(&whole.json()));
        let twice: Vec<_> = times_run(&toy.path(&store)).into_iter().filter(|(_, times)| *times > 1).collect();
        assert!(twice.is_empty(), "ran again although finished: {twice:?}");
        assert_eq!(std::fs::read_dir(toy.path(&store).join("tmp")).unwrap().count(), 0);
    }
    eprintln!("{killed} processes were killed at work, over {stores} stores");
}

#[test]
fn processes_with_other_parameters_share_what_is_equal() {
    let toy = Toy::new();
    let start = |plus: &str| {
        let words = format!("--artifacts shared run toy.toml -S evaluate.plus={plus} -S data.steps=20 --json");
        toy.command(&words).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
    };
    for child in [start("1"), start("2")] {
        assert_eq!(Ended::of(child.wait_with_output().unwrap()).code, Some(0));
    }
    let times = times_run(&toy.path("shared"));
    let (evaluations, shared): (Vec<_>, Vec<_>) = times.iter().partition(|(node, _)| node.starts_with("evaluate"));
    assert!(
        evaluations.iter().all(|(_, times)| **times == 2) && shared.iter().all(|(_, times)| **times == 1),
        "{times:?}"
    );
}

#[test]
fn processes_beside_each_other_execute_each_node_once() {
    let toy = Toy::new();
    let start = |_| command(&toy, "shared").stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let children: Vec<Child> = (0..3).map(start).collect();
    let mut executed = 0;
    for child in children {
        let ended = Ended::of(child.wait_with_output().unwrap());
        assert_eq!(ended.code, Some(0), "{ended:?}");
        assert_eq!(ended.json()["failed"], json!(0));
        executed += ended.json()["executed"].as_u64().unwrap();
    }
    let times = times_run(&toy.path("shared"));
    assert_eq!(executed as usize, times.len());
    assert!(times.values().all(|times| *times == 1), "{times:?}");
}
