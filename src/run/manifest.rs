//! What a run was: everything that `replay` needs, and where and how long it ran.

use std::{collections::BTreeMap, fs, path::Path};

use anyhow::{Context as _, bail};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::{
    events::{NodeState, RunState},
    key,
    runs::utc_now,
};
use crate::store;
use crate::{
    digest::Digest,
    env::Task,
    num::rng::Stream,
    pipeline::{Graph, Member, Node},
    stage::Kind,
};

/// The format of a manifest; raised when an older carl-pipe would misread it.
const FORMAT: u32 = 1;

/// A run, as its folder keeps it.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Manifest {
    /// See `FORMAT`.
    pub format: u32,
    /// The run's id.
    pub run: String,
    /// How it ended.
    pub state: RunState,
    /// `name` of the pipeline.
    pub pipeline: String,
    /// `description` of the pipeline.
    pub description: String,
    /// The pipeline file, to the letter.
    pub text: String,
    /// The command that started it.
    pub argv: Vec<String>,
    /// The version of carl-pipe.
    pub carl_pipe: String,
    /// The commit that it was built from, with `-dirty` where files differed; none in builds without git.
    #[serde(default)]
    pub commit: Option<String>,
    /// The pipelines that it consists of.
    #[serde(default)]
    pub members: Vec<Member>,
    /// The machine.
    pub host: Host,
    /// When it started, in UTC.
    pub started: String,
    /// From start to end, or to the last writing.
    pub wall_secs: f64,
    /// How long nodes worked in this run, added up.
    pub node_secs: f64,
    /// How much of that their recorders took.
    pub recorder_secs: f64,
    /// Every wanted node, inputs first.
    pub nodes: Vec<NodeRecord>,
}

/// The machine of a run.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Host {
    /// Its name.
    pub name: String,
    /// Its cores.
    pub cores: usize,
    /// Its system.
    pub system: String,
}

/// A node of a run.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct NodeRecord {
    /// See [`Node::name`].
    pub name: String,
    /// See [`Node::stage`].
    pub stage: String,
    /// See [`Node::member`].
    #[serde(default)]
    pub member: usize,
    /// See [`Node::round`].
    pub round: Option<u32>,
    /// See [`Node::point`].
    pub point: Vec<(String, String)>,
    /// The kind.
    pub kind: String,
    /// Its version.
    pub version: u32,
    /// See [`Node::params`].
    pub params: Value,
    /// See [`Node::task`].
    pub task: Task,
    /// See [`Node::stream`].
    pub stream: Stream,
    /// The names of the nodes connected to each port.
    pub inputs: BTreeMap<String, Vec<String>>,
    /// See [`Node::is_last`].
    pub is_last: bool,
    /// How it ended.
    pub state: NodeState,
    /// The digest of its key, once known.
    pub key: Option<Digest>,
    /// The content digest of its output, once there.
    pub output: Option<Digest>,
    /// The digest of the messages it recorded.
    pub recording: Option<Digest>,
    /// Its metrics.
    #[serde(rename = "figures")]
    pub metrics: BTreeMap<String, f64>,
    /// How long it took to make, in this run or an earlier one.
    pub secs: f64,
    /// How much of that the recorder took.
    pub recorder_secs: f64,
}

impl NodeRecord {
    /// What is known of a node before it runs.
    pub(crate) fn of(node: &Node, graph: &Graph) -> Self {
        let names = |sources: &[usize]| sources.iter().map(|&source| graph.nodes[source].name.clone()).collect();
        Self {
            name: node.name.clone(),
            stage: node.stage.clone(),
            member: node.member,
            round: node.round,
            point: node.point.clone(),
            kind: node.kind.name.to_owned(),
            version: node.kind.version,
            params: node.params.clone(),
            task: node.task.clone(),
            stream: node.stream.clone(),
            inputs: node.inputs.iter().map(|(port, sources)| (port.name.to_owned(), names(sources))).collect(),
            is_last: node.is_last,
            state: NodeState::Pending,
            key: None,
            output: None,
            recording: None,
            metrics: BTreeMap::new(),
            secs: 0.0,
            recorder_secs: 0.0,
        }
    }
}

impl Manifest {
    /// The manifest of a run that begins.
    pub(crate) fn begin(run: &str, graph: &Graph, wanted: &[bool], text: &str, argv: &[String]) -> Self {
        let nodes = graph.nodes.iter().zip(wanted).filter(|(_, wanted)| **wanted);
        Self {
            format: FORMAT,
            run: run.to_owned(),
            state: RunState::Running,
            pipeline: graph.name.clone(),
            description: graph.description.clone(),
            text: text.to_owned(),
            argv: argv.to_vec(),
            carl_pipe: env!("CARGO_PKG_VERSION").to_owned(),
            commit: option_env!("CARL_COMMIT").filter(|commit| !commit.is_empty()).map(str::to_owned),
            members: graph.members.clone(),
            host: this_host(),
            started: utc_now(),
            wall_secs: 0.0,
            node_secs: 0.0,
            recorder_secs: 0.0,
            nodes: nodes.map(|(node, _)| NodeRecord::of(node, graph)).collect(),
        }
    }

    /// Reads the manifest of a run.
    ///
    /// # Errors
    /// It is missing, damaged or of another format.
    pub fn read(run_dir: &Path) -> anyhow::Result<Self> {
        let path = run_dir.join("manifest.json");
        let text = fs::read(&path).with_context(|| format!("cannot read {}", path.display()))?;
        let json: Value = serde_json::from_slice(&text).with_context(|| format!("cannot read {}", path.display()))?;
        if json["format"] != FORMAT {
            bail!("{} is of format {}, but this carl-pipe reads format {FORMAT}", path.display(), json["format"]);
        }
        let mut manifest: Self =
            serde_json::from_value(json).with_context(|| format!("cannot read {}", path.display()))?;
        if manifest.members.is_empty() {
            // Written before there were suites.
            manifest.members.push(Member { pipeline: manifest.pipeline.clone(), ..Member::default() });
        }
        if manifest.nodes.iter().any(|node| node.member >= manifest.members.len()) {
            bail!("{} names a pipeline that it does not list", path.display());
        }
        Ok(manifest)
    }

    /// Writes the manifest whole; `durable` also makes it safe from a power cut.
    pub(crate) fn write(&self, run_dir: &Path, durable: bool) -> anyhow::Result<()> {
        let mut text = serde_json::to_vec_pretty(self).context("a manifest is plain data")?;
        text.push(b'\n');
        store::replace(&run_dir.join("manifest.json"), &text, durable)
    }

    /// The readable key of a node, with every input whose content is known.
    pub fn key_of(&self, node: &NodeRecord) -> Value {
        let output = |name: &String| {
            let source = self.nodes.iter().find(|node| node.name == *name);
            source.and_then(|source| source.output).map_or(Value::Null, |digest| Value::from(digest.to_string()))
        };
        let inputs: Map<_, _> = node
            .inputs
            .iter()
            .filter(|(_, sources)| !sources.is_empty())
            .map(|(port, sources)| (port.clone(), sources.iter().map(output).collect()))
            .collect();
        serde_json::json!({
            "kind": node.kind,
            "version": node.version,
            "params": node.params,
            "task": node.task,
            "stream": node.stream,
            "platform": key::PLATFORM,
            "inputs": inputs,
        })
    }

    /// The graph of the run again, from what the manifest alone says.
    ///
    /// # Errors
    /// A kind or a version that this carl-pipe does not have.
    pub fn graph(&self, kind: &dyn Fn(&str) -> Option<&'static Kind>) -> anyhow::Result<Graph> {
        let mut nodes: Vec<Node> = Vec::new();
        for record in &self.nodes {
            let found = kind(&record.kind).with_context(|| format!("there is no kind `{}` any more", record.kind))?;
            if found.version != record.version {
                bail!("`{}` is now version {}, the run had version {}", record.kind, found.version, record.version);
            }
            let mut inputs = Vec::new();
            for port in found.ports {
                let sources = record.inputs.get(port.name).map_or(&[][..], Vec::as_slice);
                let position = |name: &String| nodes.iter().position(|node| node.name == *name);
                let sources: Option<Vec<_>> = sources.iter().map(position).collect();
                let sources = sources.with_context(|| format!("the manifest lacks an input of `{}`", record.name))?;
                inputs.push((port, sources));
            }
            nodes.push(Node {
                name: record.name.clone(),
                stage: record.stage.clone(),
                member: record.member,
                round: record.round,
                point: record.point.clone(),
                kind: found,
                params: record.params.clone(),
                task: record.task.clone(),
                stream: record.stream.clone(),
                inputs,
                is_last: record.is_last,
            });
        }
        let (name, description) = (self.pipeline.clone(), self.description.clone());
        Ok(Graph { name, description, members: self.members.clone(), nodes })
    }
}

fn this_host() -> Host {
    Host {
        name: fs::read_to_string("/proc/sys/kernel/hostname")
            .map_or_else(|_| String::new(), |name| name.trim().to_owned()),
        cores: std::thread::available_parallelism().map_or(1, usize::from),
        system: format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
    }
}
