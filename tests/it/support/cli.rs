//! The whole program with three toy kinds, as a process of its own: this test binary starts itself again.
#![allow(dead_code)]

use std::{
    collections::BTreeMap,
    ffi::OsString,
    fs,
    path::{Path, PathBuf},
    process::{Command, Output, Stdio},
    time::Duration,
};

use anyhow::bail;
use carl_pipe::{
    artifact::{Artifact, Files},
    record::At,
    stage::{Arity, InputFiles, Inputs, Kind, Params, Port, PortField, PresetOf, Stage, StageCx, load_port},
};
use rand::RngExt as _;
use serde::{Deserialize, Serialize};
use serde_json::Value;

macro_rules! artifact {
    ($name:ident, $ty:literal) => {
        pub struct $name(f64);
        impl Artifact for $name {
            const TYPE: &'static str = $ty;
            fn save(self) -> anyhow::Result<Files> {
                Ok(Files::from([("value.json".to_owned(), serde_json::to_vec(&self.0)?)]))
            }
            fn load(files: &Files) -> anyhow::Result<Self> {
                Ok(Self(serde_json::from_slice(&files.bytes("value.json")?)?))
            }
        }
    };
}
artifact!(Number, "number");
artifact!(Evaluation, "evaluation");

/// What toy kinds take.
#[derive(Debug, Default, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ToyParams {
    /// What to add.
    plus: f64,
    /// Steps of ten milliseconds.
    steps: u64,
    /// Fails with this sentence.
    fail: String,
}

impl Params for ToyParams {
    fn preset(_of: &PresetOf<'_>) -> Self {
        Self { steps: 3, ..Self::default() }
    }
}

impl ToyParams {
    fn work(&self, from: f64, cx: &mut StageCx<'_>) -> anyhow::Result<f64> {
        let mut value = from + self.plus;
        for step in 0..self.steps {
            std::thread::sleep(Duration::from_millis(10));
            value += f64::from(cx.rng(("step", step)).random_range(0..10_u32));
            cx.record.scalars("/value", At::new(cx.round, 0, step), &[("value", value)]);
            cx.progress(step + 1, self.steps, &format!("value {value}"))?;
        }
        if !self.fail.is_empty() {
            bail!("{}", self.fail);
        }
        Ok(value)
    }
}

pub struct NoInputs;
impl Inputs for NoInputs {
    const PORTS: &'static [Port] = &[];
    fn load(_files: &InputFiles<'_>) -> anyhow::Result<Self> {
        Ok(Self)
    }
}

pub struct Terms {
    terms: Vec<Number>,
    before: Option<Number>,
}
impl Inputs for Terms {
    const PORTS: &'static [Port] = &[
        Port { name: "terms", artifact: "number", arity: <Vec<Number>>::ARITY, about: "what to add" },
        Port { name: "before", artifact: "number", arity: <Option<Number>>::ARITY, about: "what to go on from" },
    ];
    fn load(files: &InputFiles<'_>) -> anyhow::Result<Self> {
        Ok(Self { terms: load_port(files, "terms")?, before: load_port(files, "before")? })
    }
}

pub struct One {
    number: Number,
}
impl Inputs for One {
    const PORTS: &'static [Port] =
        &[Port { name: "number", artifact: "number", arity: Arity::One, about: "what to judge" }];
    fn load(files: &InputFiles<'_>) -> anyhow::Result<Self> {
        Ok(Self { number: load_port(files, "number")? })
    }
}

macro_rules! kind {
    ($name:ident, $kind:literal, $headline:expr, $inputs:ty, $output:ident, |$in:ident, $cx:ident| $from:expr) => {
        pub struct $name;
        impl Stage for $name {
            const KIND: &'static str = $kind;
            const VERSION: u32 = 1;
            const ABOUT: &'static str = "toys with numbers";
            const HEADLINE: Option<&'static str> = $headline;
            type Params = ToyParams;
            type Inputs = $inputs;
            type Output = $output;
            fn run(params: &ToyParams, $in: $inputs, $cx: &mut StageCx<'_>) -> anyhow::Result<$output> {
                let from = $from;
                let value = params.work(from, $cx)?;
                if let Some(metric) = Self::HEADLINE {
                    $cx.metric(metric, value % 100.0);
                }
                Ok($output(value))
            }
        }
    };
}
kind!(ToyNumber, "toy_number", None, NoInputs, Number, |_inputs, cx| 0.0);
kind!(ToySum, "toy_sum", None, Terms, Number, |inputs, cx| {
    inputs.terms.iter().map(|it| it.0).sum::<f64>() + inputs.before.map_or(0.0, |it| it.0)
});
kind!(ToyEvaluate, "toy_evaluate", Some("percent_goal"), One, Evaluation, |inputs, cx| inputs.number.0);

fn kinds() -> &'static [Kind] {
    static KINDS: std::sync::LazyLock<[Kind; 3]> =
        std::sync::LazyLock::new(|| [Kind::of::<ToyNumber>(), Kind::of::<ToySum>(), Kind::of::<ToyEvaluate>()]);
    &*KINDS
}

/// Becomes the program when started by [`Toy::command`]. The test `the_program` of the test binary calls it.
pub fn be_the_program() {
    if let Ok(argv) = std::env::var("CARL_TOY_ARGV") {
        let argv: Vec<OsString> =
            serde_json::from_str::<Vec<String>>(&argv).unwrap().into_iter().map(Into::into).collect();
        println!("{BEGIN}");
        std::process::exit(carl_pipe::cli::main(&argv, kinds()).into());
    }
}

/// What the test harness says comes before this line.
const BEGIN: &str = "--- the program begins ---";

pub const PIPELINE: &str = r#"schema = 1
name = "toy"
description = "Numbers that grow"
seed = 0

[task]
env = "planar"

[loop]
rounds = 3

[stages.data]
kind = "toy_number"
plus = 5

[stages.learn]
kind = "toy_sum"
loop = true
inputs = { terms = ["data"], before = "learn@prev" }

[stages.evaluate]
kind = "toy_evaluate"
loop = true
inputs = { number = "learn" }
"#;

/// A folder with a pipeline and a store.
pub struct Toy {
    pub folder: tempfile::TempDir,
}

impl Toy {
    pub fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("toy.toml"), PIPELINE).unwrap();
        Self { folder }
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// The program, with words split at spaces, in the folder.
    pub fn command(&self, words: &str) -> Command {
        let mut argv = vec!["carl-pipe"];
        argv.extend(words.split_whitespace());
        let mut command = Command::new(std::env::current_exe().unwrap());
        command
            .args(["the_program", "--exact", "--nocapture", "--test-threads=1"])
            .env("CARL_TOY_ARGV", serde_json::to_string(&argv).unwrap())
            .env("COLUMNS", "100")
            .env_remove("CARL_ARTIFACTS")
            .env_remove("RUST_BACKTRACE")
            .current_dir(self.folder.path())
            .stdin(Stdio::null());
        command
    }

    pub fn run(&self, words: &str) -> Ended {
        Ended::of(self.command(words).output().unwrap())
    }
}

/// The command with a terminal as its input and output, which the program `script` makes.
pub fn on_terminal(command: &Command) -> Command {
    let quoted =
        std::iter::once(command.get_program()).chain(command.get_args()).map(|word| format!("'{}'", word.display()));
    let mut terminal = Command::new("script");
    terminal.args(["-qec", &quoted.collect::<Vec<_>>().join(" "), "/dev/null"]).stdin(Stdio::null());
    terminal.current_dir(command.get_current_dir().unwrap());
    for (name, value) in command.get_envs() {
        if let Some(value) = value {
            terminal.env(name, value);
        }
    }
    terminal.env_remove("NO_COLOR").env_remove("CLICOLOR").env_remove("CI");
    terminal
}

/// A signal that asks a run to stop: INT, or TERM where the tests themselves run with INT ignored, as in the background of
/// a shell.
pub fn stop_signal() -> rustix::process::Signal {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| u64::from_str_radix(line.strip_prefix("SigIgn:")?.trim(), 16).ok());
    let int = rustix::process::Signal::INT;
    let is_ignored = mask.is_some_and(|mask| mask >> (int.as_raw() - 1) & 1 == 1);
    if is_ignored { rustix::process::Signal::TERM } else { int }
}

/// How a process ended.
#[derive(Debug)]
pub struct Ended {
    pub code: Option<i32>,
    pub out: String,
    pub err: String,
}

impl Ended {
    pub fn of(output: Output) -> Self {
        let out = String::from_utf8(output.stdout).unwrap();
        let out = out.split_once(&format!("{BEGIN}\n")).map_or(out.clone(), |(_, rest)| rest.to_owned());
        Self { code: output.status.code(), out, err: String::from_utf8(output.stderr).unwrap() }
    }

    /// The last line of standard output as JSON.
    pub fn json(&self) -> Value {
        serde_json::from_str(self.out.lines().last().unwrap_or_else(|| panic!("no output: {self:?}"))).unwrap()
    }
}

/// How often each node ran in all runs of a store, from their events.
pub fn times_run(store: &Path) -> BTreeMap<String, usize> {
    let mut times = BTreeMap::new();
    for run in fs::read_dir(store.join("runs")).unwrap().flatten().filter(|run| run.file_type().unwrap().is_dir()) {
        let text = fs::read_to_string(run.path().join("events.jsonl")).unwrap_or_default();
        for event in text.lines().filter_map(|line| serde_json::from_str::<Value>(line).ok()) {
            if event["event"] == "node_finished" && event["state"] == "ran" {
                *times.entry(event["node"].as_str().unwrap().to_owned()).or_default() += 1;
            }
        }
    }
    times
}

/// Each node's output and recording digests, from the last line of `run --json`.
pub fn digests(json: &Value) -> BTreeMap<String, (Value, Value)> {
    let nodes = json["nodes"].as_object().unwrap();
    nodes.iter().map(|(name, node)| (name.clone(), (node["digest"].clone(), node["recording"].clone()))).collect()
}

/// Compares with the text kept under `tests/it/cli/snapshots/`; `UPDATE_SNAPSHOTS=1` keeps this one instead.
pub fn assert_snapshot(name: &str, text: &str) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/it/cli/snapshots").join(format!("{name}.txt"));
    if std::env::var_os("UPDATE_SNAPSHOTS").is_some() {
        fs::write(&path, text).unwrap();
    }
    let kept = fs::read_to_string(&path).unwrap_or_default();
    assert_eq!(text, kept, "differs from {}; UPDATE_SNAPSHOTS=1 keeps the new text", path.display());
}
