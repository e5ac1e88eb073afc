//! A task whose environment runs in another process: `tests/process/lamp.py`, which needs a Python without packages.

#![allow(clippy::disallowed_methods, reason = "tests wait and measure")]

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    process::{Child, Command, Output, Stdio},
    time::{Duration, Instant},
};

use crate::support::python::python_has;
use serde_json::Value;

const PIPELINE: &str = r#"
schema = 1
name = "lamp"
seed = 0

[task]
env = "process"
command = ["python3", "lamp.py"]
files = ["carl_env.py"]
timeout = 20
options = {}

[stages.bootstrap]
kind = "generate_data"
samples = 30

[stages.represent]
kind = "train_lce"
epochs = 4
warm_up.epochs = 2
warm_up.anchor_epochs = 1
ramp.epochs = 1
restarts = 0
inputs = { transitions = "bootstrap" }

[stages.control]
kind = "train_sac"
steps = 5
inputs = { transitions = "bootstrap", model = "represent" }

[stages.evaluate]
kind = "evaluate"
episodes = 2
inputs = { model = "represent", agent = "control" }
"#;

/// A folder with the pipeline and its program; `None` where there is no Python.
struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Option<Self> {
        if !Command::new("python3").arg("--version").output().is_ok_and(|output| output.status.success()) {
            assert!(std::env::var_os("CI").is_none(), "CI has a Python");
            eprintln!("skipped: there is no `python3`");
            return None;
        }
        let folder = Self(tempfile::tempdir().unwrap());
        let root = Path::new(env!("CARGO_MANIFEST_DIR"));
        fs::copy(root.join("python/carl_env/__init__.py"), folder.path("carl_env.py")).unwrap();
        fs::copy(root.join("tests/process/lamp.py"), folder.path("lamp.py")).unwrap();
        fs::write(folder.path("lamp.toml"), PIPELINE).unwrap();
        Some(folder)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// `carl-pipe` with the words of a line, from another folder than that of the pipeline.
    fn command(&self, line: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_carl-pipe"));
        command.args(line.split(' ')).current_dir("/");
        command.env("XDG_CACHE_HOME", self.path("cache")).env("PYTHONDONTWRITEBYTECODE", "1");
        command.env("CARL_ARTIFACTS", self.path("store")).stdin(Stdio::null());
        command
    }

    fn carl(&self, line: &str) -> Output {
        self.command(line).output().unwrap()
    }

    fn run(&self, more: &str) -> Output {
        let file = self.path("lamp.toml");
        self.carl(&format!("run {}{more}", file.display()))
    }

    /// The states of the nodes in the newest run, and the digests of their outputs.
    fn nodes(&self, store: &str) -> BTreeMap<String, (String, String)> {
        let text = fs::read_to_string(self.path(store).join("runs/latest/manifest.json")).unwrap();
        let manifest: Value = serde_json::from_str(&text).unwrap();
        let nodes = manifest["nodes"].as_array().unwrap().iter();
        let word = |node: &Value, name: &str| node[name].as_str().unwrap_or_default().to_owned();
        nodes.map(|node| (word(node, "name"), (word(node, "state"), word(node, "output")))).collect()
    }

    /// The environments that were started and still live.
    fn living(&self) -> Vec<String> {
        let pids = fs::read_to_string(self.path("pids")).unwrap_or_default();
        let lives = |pid: &&str| {
            let about = fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
            !about.is_empty() && !about.contains(") Z ")
        };
        pids.lines().filter(lives).map(str::to_owned).collect()
    }
}

fn text(output: &Output) -> String {
    format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr))
}

fn must_be(output: &Output, code: i32) {
    assert_eq!(output.status.code(), Some(code), "{}", text(output));
}

#[test]
fn an_environment_in_another_process_runs_is_cached_and_replays() {
    let Some(folder) = Folder::new() else { return };
    let first = folder.run("");
    must_be(&first, 0);
    assert!(text(&first).contains("bootstrap: a line on standard output"), "{}", text(&first));
    let made = folder.nodes("store");
    assert!(made.values().all(|(state, _)| state == "ran"), "{made:?}");

    // Another store, another folder of the same program: the same bytes.
    let other = Folder::new().unwrap();
    must_be(&other.run(""), 0);
    assert_eq!(other.nodes("store"), made);

    // A comment and another timeout change nothing.
    let changed = PIPELINE.replace("timeout = 20", "timeout = 30 # seconds");
    fs::write(folder.path("lamp.toml"), changed).unwrap();
    must_be(&folder.run(""), 0);
    assert!(folder.nodes("store").values().all(|(state, _)| state == "cached"));

    must_be(&folder.carl("replay latest"), 0);

    // An edit of the program makes everything again.
    let program = fs::read_to_string(folder.path("lamp.py")).unwrap();
    fs::write(folder.path("lamp.py"), format!("{program}\n# edited\n")).unwrap();
    let refused = folder.carl("replay latest");
    must_be(&refused, 1);
    assert!(text(&refused).contains("is not the file that the run was planned with"), "{}", text(&refused));
    must_be(&folder.run(""), 0);
    let (bootstrap, _) = &folder.nodes("store")["bootstrap"];
    assert_eq!(bootstrap, "ran");
    assert_eq!(folder.living(), [""; 0]);
}

#[test]
fn planning_again_starts_no_environment() {
    let Some(folder) = Folder::new() else { return };
    let status = || must_be(&folder.carl(&format!("status {}", folder.path("lamp.toml").display())), 10);
    let started = || fs::read_to_string(folder.path("pids")).unwrap().lines().count();
    status();
    assert_eq!(started(), 1);
    status();
    assert_eq!(started(), 1);
}

#[test]
fn every_fault_of_an_environment_is_a_clear_error_within_its_timeout() {
    let Some(folder) = Folder::new() else { return };
    for (fault, why) in [
        ("die", &["the environment ended (exit status: 3)", "the lamp burns out"][..]),
        ("hang", &["did not answer within 6 s", "raise `timeout`"]),
        ("fail", &["the environment failed: ValueError: the lamp is broken"]),
        ("shape", &["another shape than it said at the start"]),
        ("nan", &["the environment's true state holds NaN"]),
        ("garbage", &["is no message of the protocol"]),
    ] {
        let start = Instant::now();
        let timeout = if fault == "hang" { " -S task.timeout=6" } else { "" };
        let output = folder.run(&format!(" -S task.options.fault=\"{fault}\"{timeout}"));
        must_be(&output, 1);
        why.iter().for_each(|why| assert!(text(&output).contains(why), "{fault}: {}", text(&output)));
        assert!(start.elapsed() < Duration::from_secs(100), "{fault} took too long");
        assert_eq!(folder.nodes("store")["bootstrap"], ("failed".to_owned(), String::new()), "{fault}");
        assert_eq!(folder.living(), [""; 0], "{fault}");
    }
}

#[test]
fn a_task_that_cannot_be_opened_is_a_mistake_of_the_file() {
    let Some(folder) = Folder::new() else { return };
    for (change, why) in [
        ("task.options.fault=\"protocol\"", "the environment speaks version 2 of the protocol"),
        (
            "task.options.fault=\"describe\"",
            "the environment failed: OSError: no lamp; its last line: OSError: no lamp",
        ),
        ("task.command=[\"python3\",\"-c\",\"print(1234567)\"]", "is no message of the protocol"),
        ("task.command=[\"./none\"]", "cannot start the environment `./none`"),
        ("task.command=[]", "names no program"),
        ("task.files=[\"none.py\"]", "cannot read `none.py`"),
        ("task.packages=[\"no-such-package\"]", "`python3` does not have `no-such-package`"),
        ("task.timeout=0", "must be above 0"),
        ("task.torque=1", "`torque` is no option of `process`"),
    ] {
        let output = folder.run(&format!(" -S {change}"));
        must_be(&output, 3);
        assert!(text(&output).contains(why), "{change}: {}", text(&output));
    }
    assert_eq!(folder.living(), [""; 0]);
}

/// A run whose environment never answers.
fn hanging(folder: &Folder) -> Child {
    let file = folder.path("lamp.toml");
    let line = format!("run {} -S task.options.fault=\"hang\"", file.display());
    let mut run = folder.command(&line).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let planned_and_running = || fs::read_to_string(folder.path("pids")).is_ok_and(|pids| pids.lines().count() == 2);
    if !within(60, planned_and_running) {
        _ = run.kill();
        panic!("no environment has started");
    }
    run
}

/// Whether something becomes true within some seconds.
fn within(secs: u64, mut is_so: impl FnMut() -> bool) -> bool {
    let start = Instant::now();
    while !is_so() {
        if start.elapsed() > Duration::from_secs(secs) {
            return false;
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    true
}

#[test]
fn no_environment_outlives_a_killed_run() {
    let Some(folder) = Folder::new() else { return };
    let mut run = hanging(&folder);
    assert_eq!(folder.living().len(), 1);
    run.kill().unwrap();
    run.wait().unwrap();
    assert!(within(5, || folder.living().is_empty()));
}

/// Needs a Python with numpy: `pip install -r tests/python/requirements.txt`.
#[test]
fn the_adapter_of_gymnasium_makes_the_right_pictures() {
    if !python_has("numpy") {
        return;
    }
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("python");
    let mut tests = Command::new("python3");
    tests.args(["-m", "unittest"]).current_dir(folder).env("PYTHONDONTWRITEBYTECODE", "1");
    must_be(&tests.output().unwrap(), 0);
}
