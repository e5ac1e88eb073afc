//! A viewer that accepts a connection and then never reads cannot hold up a run, change its results, or keep
//! `carl-view` alive.

#![allow(clippy::disallowed_methods, reason = "tests wait and measure")]

use std::{
    ffi::OsString,
    fs,
    net::TcpListener,
    path::Path,
    process::{Command, Output},
    time::{Duration, Instant},
};

use serde_json::Value;

use crate::sample_run;

const PIPELINE: &str = r#"
schema = 1
name = "watched"
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
warm_up.epochs = 2
warm_up.anchor_epochs = 1
ramp.epochs = 1
"#;

const CARL_VIEW: &str = env!("CARGO_BIN_EXE_carl-view");
/// Tells this test binary to become carl-pipe; the value is the arguments, separated by newlines.
const ARGUMENTS: &str = "CARL_PIPE_ARGUMENTS";

/// A viewer whose connections stay in the backlog, because nobody accepts them.
struct HungViewer(TcpListener);

impl HungViewer {
    fn start() -> HungViewer {
        HungViewer(TcpListener::bind("127.0.0.1:0").unwrap())
    }

    fn sink(&self) -> String {
        format!("connect=rerun+http://{}/proxy", self.0.local_addr().unwrap())
    }

    fn somebody_connected(&self) -> bool {
        self.0.set_nonblocking(true).unwrap();
        self.0.accept().is_ok()
    }
}

/// `carl-pipe`, as a process of its own: cargo builds its program only for the tests of its own package, so this test
/// binary starts itself again and calls the program's `main`.
#[test]
fn the_program() {
    let Ok(arguments) = std::env::var(ARGUMENTS) else { return };
    let arguments: Vec<OsString> = ["carl-pipe"].into_iter().chain(arguments.lines()).map(OsString::from).collect();
    std::process::exit(carl_pipe::cli::main(&arguments, carl_pipe::stage::registry()).into());
}

/// Runs the pipeline with `carl-view` on the PATH; returns the last line of `--json`.
fn run(folder: &Path, store: &str, more: &[&str]) -> Value {
    let mut arguments = vec!["--artifacts", store, "run", "watched.toml", "--json"];
    arguments.extend(more);
    let output: Output = Command::new(std::env::current_exe().unwrap())
        .args(["hung_viewer::the_program", "--exact", "--nocapture", "--test-threads=1"])
        .env(ARGUMENTS, arguments.join("\n"))
        .env("PATH", Path::new(CARL_VIEW).parent().unwrap())
        .current_dir(folder)
        .output()
        .unwrap();
    assert!(output.status.success(), "{output:?}");
    let text = String::from_utf8(output.stdout).unwrap();
    serde_json::from_str(text.lines().last().unwrap()).unwrap()
}

#[test]
fn a_hung_viewer_leaves_the_run_alone() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("watched.toml"), PIPELINE).unwrap();
    let viewer = HungViewer::start();
    let alone = run(folder.path(), "alone", &[]);
    let watched = run(folder.path(), "watched", &["--rerun", &viewer.sink()]);
    assert_eq!(watched["executed"], 2);
    assert!(viewer.somebody_connected());
    for node in ["bootstrap", "represent"] {
        for digest in ["digest", "recording"] {
            assert!(alone["nodes"][node][digest].is_string(), "{alone}");
            assert_eq!(alone["nodes"][node][digest], watched["nodes"][node][digest]);
        }
    }
}

#[test]
fn carl_view_ends_although_its_viewer_hangs() {
    let folder = tempfile::tempdir().unwrap();
    sample_run::write_run(folder.path(), 5);
    let viewer = HungViewer::start();
    let started = Instant::now();
    let output =
        Command::new(CARL_VIEW).args(["--rerun", &viewer.sink(), "--follow"]).arg(folder.path()).output().unwrap();
    assert!(started.elapsed() < Duration::from_secs(30), "{output:?}");
    assert!(viewer.somebody_connected());
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(said.contains("the viewer may not have received everything"), "{said}");
}
