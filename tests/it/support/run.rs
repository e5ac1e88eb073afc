//! A toy kind that adds numbers and misbehaves when asked to, and short functions that build and run graphs of it.
#![allow(dead_code)]

use std::{
    fs::{self, OpenOptions},
    io::Write as _,
    path::{Path, PathBuf},
    sync::Mutex,
    time::Duration,
};

use anyhow::{bail, ensure};
use carl_pipe::{
    artifact::Files,
    num::rng::Stream,
    pipeline::{Graph, Member, Node},
    run::{
        events::{Event, Listener, NodeState},
        execute::{self, Options, Order, Report},
        node::NodeRecord,
        plan::select,
        runs,
    },
    stage::{Arity, InputFiles, Kind, Port, StageCx},
    store::{LocalStore, Lookup, ResultStore as _},
};
use serde_json::{Value, json};

static PORTS: [Port; 1] = [Port { name: "terms", artifact: "number", arity: Arity::Many, about: "what to add" }];

fn adder(name: &'static str, version: u32) -> Kind {
    Kind {
        name,
        version,
        about: "adds its terms",
        headline: Some("total"),
        repeats: true,
        ports: &PORTS,
        output: "number",
        readable_as: &[],
        preset: |_| json!({}),
        schema: || schemars::schema_for!(u32),
        canonical: |params| Ok(params.clone()),
        check: |_, _| Ok(Vec::new()),
        needs: |_| Ok(&[]),
        complete: |params, _| Ok((params, Vec::new())),
        files: |_| Ok(Vec::new()),
        declare: None,
        run: add,
    }
}

/// The kind, and the same with a higher version.
pub fn kinds() -> &'static [Kind] {
    static KINDS: std::sync::LazyLock<[Kind; 2]> =
        std::sync::LazyLock::new(|| [adder("add", 1), adder("add_again", 1)]);
    &*KINDS
}

/// The kind of this name.
pub fn kind(name: &str) -> Option<&'static Kind> {
    kinds().iter().find(|kind| kind.name == name)
}

/// Adds the terms and `plus`; `modulo` forgets, `trace` counts runs, `behaviour` misbehaves.
fn add(params: &Value, inputs: &InputFiles<'_>, cx: &mut StageCx<'_>) -> anyhow::Result<Files> {
    if let Some(trace) = params["trace"].as_str() {
        OpenOptions::new().create(true).append(true).open(trace)?.write_all(b"x")?;
    }
    let mut sum = params["plus"].as_i64().unwrap_or(0);
    for files in inputs.by_port.get("terms").into_iter().flatten() {
        let number: i64 = std::str::from_utf8(&files.bytes("number.txt")?)?.parse()?;
        sum += number;
    }
    if let Some(modulo) = params["modulo"].as_i64() {
        sum %= modulo;
    }
    for done in 0..params["ticks"].as_u64().unwrap_or(0) {
        std::thread::sleep(Duration::from_millis(5));
        cx.progress(done, 1000, "")?;
    }
    let (behaviour, argument) = params["behaviour"].as_str().unwrap_or("").split_once(':').unwrap_or_default();
    match behaviour {
        "fail" => bail!("cannot add: {argument}"),
        "panic" => panic!("{argument}"),
        "read" => sum += fs::read_to_string(argument)?.trim().parse::<i64>()?,
        "mkdir" => fs::create_dir(argument)?,
        "damage" => damage(Path::new(argument)),
        "all_cores" => ensure!(cx.threads.get() >= 2, "got {} threads", cx.threads.get()),
        _ => {}
    }
    cx.metric("total", sum as f64);
    let mut files = Files::from([("number.txt".to_owned(), sum.to_string().into_bytes())]);
    if let Some(bytes) = params["ballast"].as_u64() {
        files.insert("ballast.bin".to_owned(), vec![7; bytes as usize]);
    }
    Ok(files)
}

/// Flips a bit of a file in place.
pub fn damage(path: &Path) {
    let mut bytes = fs::read(path).unwrap();
    bytes[0] ^= 1;
    fs::remove_file(path).unwrap();
    fs::write(path, bytes).unwrap();
}

/// Wires a graph: name, parameters and the names of its terms.
pub fn graph(nodes: &[(&str, Value, &[&str])]) -> Graph {
    let members = vec![Member { pipeline: "sums".to_owned(), ..Member::default() }];
    let mut graph = Graph { name: "sums".to_owned(), description: String::new(), members, nodes: Vec::new() };
    for (name, params, terms) in nodes {
        let at = |term: &&str| graph.nodes.iter().position(|node| node.name == **term).expect("made before");
        let sources = terms.iter().map(at).collect();
        graph.nodes.push(Node {
            name: (*name).to_owned(),
            stage: name.split('@').next().unwrap().to_owned(),
            member: 0,
            round: name.split('@').nth(1).map(|round| round.parse().unwrap()),
            point: Vec::new(),
            kind: kind("add").unwrap(),
            params: params.clone(),
            task: serde_json::from_value(json!({"env": "planar"})).unwrap(),
            files: Vec::new(),
            platform: carl_pipe::num::PLATFORM,
            stream: Stream { seed: 0, kind: "add".to_owned(), round: 0, stream: None },
            inputs: vec![(&PORTS[0], sources)],
            is_last: true,
        });
    }
    graph
}

/// Keeps every event.
#[derive(Default)]
pub struct Ear(Mutex<Vec<Event>>);

impl Listener for Ear {
    fn on_event(&self, event: &Event) {
        self.0.lock().unwrap().push(event.clone());
    }
}

impl Ear {
    pub fn warnings(&self) -> Vec<String> {
        let events = self.0.lock().unwrap();
        events
            .iter()
            .filter_map(|it| if let Event::Warning { text, .. } = it { Some(text.clone()) } else { None })
            .collect()
    }

    /// The nodes that ran, in the order in which they ended.
    pub fn ran(&self) -> Vec<String> {
        let events = self.0.lock().unwrap();
        let ran = events.iter().filter_map(|event| match event {
            Event::NodeFinished { node, state: NodeState::Ran, .. } => Some(node.clone()),
            _ => None,
        });
        ran.collect()
    }
}

/// A store in a folder of its own.
pub struct Bench {
    pub folder: tempfile::TempDir,
    pub store: LocalStore,
}

impl Bench {
    pub fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let store = LocalStore::open(&folder.path().join("artifacts")).unwrap();
        Self { folder, store }
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// The folder of the runs.
    pub fn runs(&self) -> PathBuf {
        runs::folder(self.store.root())
    }

    pub fn run(&self, graph: &Graph) -> (Report, Ear) {
        self.run_with(graph, &Options::default())
    }

    pub fn run_with(&self, graph: &Graph, options: &Options) -> (Report, Ear) {
        let ear = Ear::default();
        let report = run(&self.store, graph, options, &ear).unwrap();
        (report, ear)
    }

    /// Where the object of a node's `number.txt` lies.
    pub fn object(&self, report: &Report, node: &str) -> PathBuf {
        fs::canonicalize(report.path.join(format!("{node}.number.txt"))).unwrap()
    }

    /// Where the entry of a node lies.
    pub fn entry(&self, report: &Report, node: &str) -> PathBuf {
        let manifest = carl_pipe::run::manifest::Manifest::read(&report.path).unwrap();
        let key = manifest.nodes.iter().find(|record| record.about.name == node).unwrap().outcome.key.unwrap();
        assert!(matches!(self.store.find(key).unwrap(), Lookup::Hit(_)));
        let hex = key.hex();
        self.store.root().join("keys").join(&hex[..2]).join(format!("{}.json", &hex[2..]))
    }
}

pub fn run(store: &LocalStore, graph: &Graph, options: &Options, ear: &Ear) -> anyhow::Result<Report> {
    let order = Order { graph, wanted: select(graph, &[]).unwrap(), text: "", argv: Vec::new(), note: None };
    execute::run(store, &runs::folder(store.root()), &order, options, ear)
}

/// How often the nodes with this trace ran.
pub fn count(trace: &Path) -> usize {
    fs::read(trace).map_or(0, |bytes| bytes.len())
}

/// The record of a node.
pub fn record<'a>(report: &'a Report, node: &str) -> &'a NodeRecord {
    report.node(node).unwrap().record
}

/// The state of a node.
pub fn state(report: &Report, node: &str) -> NodeState {
    record(report, node).outcome.state
}

/// `a -> b -> c`.
pub fn chain(plus: i64) -> Graph {
    graph(&[("a", json!({"plus": plus}), &[]), ("b", json!({"plus": 10}), &["a"]), ("c", json!({"plus": 100}), &["b"])])
}
