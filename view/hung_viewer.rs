//! A viewer that takes the connection and then says nothing cannot hold up a run or change what it makes.

#![cfg(feature = "rerun")]

use crate::support::cli;
use std::{net::TcpListener, path::Path, process::Command};

use crate::support::cli::Ended;

const PIPELINE: &str = r#"
schema = 1
name = "seen"
seed = 0
preset = "recipe"

[task]
env = "planar"

[stages.bootstrap]
kind = "generate_data"
samples = 64

[stages.represent]
kind = "train_lce"
inputs = { transitions = "bootstrap" }
epochs = 4
warm_up_epochs = 2
anchor_epochs = 1
ramp_epochs = 1
"#;

fn run(folder: &Path, store: &str, rest: &[&str]) -> Ended {
    let mut command = Command::new(env!("CARGO_BIN_EXE_carl-pipe"));
    command.current_dir(folder).args(["--artifacts", store, "run", "seen.toml", "--json"]).args(rest);
    Ended::of(command.output().unwrap())
}

#[test]
fn a_hung_viewer_leaves_the_run_alone() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("seen.toml"), PIPELINE).unwrap();
    // Connections end up in its backlog; nobody accepts them.
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let viewer = format!("connect=rerun+http://{}/proxy", listener.local_addr().unwrap());
    let alone = run(folder.path(), "alone", &[]);
    let watched = run(folder.path(), "watched", &["--rerun", &viewer]);
    assert_eq!((alone.code, watched.code), (Some(0), Some(0)), "{alone:?} {watched:?}");
    assert_eq!(cli::digests(&alone.json()), cli::digests(&watched.json()));
    assert_eq!(watched.json()["executed"], 2);
}
