//! The manifest of a run: everything that a replay needs, and where and how long the run was.

mod file;

use std::{
    fs,
    path::{Path, PathBuf},
};

use anyhow::{Context as _, bail};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::{
    events::RunState,
    key, named_files,
    node::{NodeDescription, NodeOutcome, NodeRecord},
    utc,
};
use crate::{
    digest::Digest,
    num,
    pipeline::{Graph, Member, Node, NodeFile, NodeId},
    stage::{Kind, NamedFile, Port},
};

pub use file::Unreadable;
use file::{FORMAT, UNSEALED};

/// A run, as its folder keeps it.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Manifest {
    /// The run's number: one above the highest of all runs before it. `None` in manifests from before runs had one.
    #[serde(default)]
    pub number: Option<u64>,
    /// The format of the manifest.
    pub format: u32,
    /// The id of the run.
    pub run: String,
    /// How it ended.
    pub state: RunState,
    /// `name` of the pipeline.
    pub pipeline: String,
    /// `description` of the pipeline.
    pub description: String,
    /// The exact text of the pipeline file.
    pub text: String,
    /// The command that started it.
    pub argv: Vec<String>,
    /// The version of carl-pipe.
    pub carl_pipe: String,
    /// The commit that carl-pipe was built from, with `-dirty` where files differed. `None` for builds without git.
    #[serde(default)]
    pub commit: Option<String>,
    /// The pipelines that the run consists of.
    #[serde(default)]
    pub members: Vec<Member>,
    /// The machine.
    pub host: Host,
    /// When it started, in UTC.
    pub started: String,
    /// Seconds from start to end, or to the last time that the manifest was written.
    pub wall_secs: f64,
    /// Seconds that nodes worked in this run, summed over nodes.
    pub node_secs: f64,
    /// Seconds of these that recorders took.
    pub recorder_secs: f64,
    /// Every wanted node, inputs first.
    pub nodes: Vec<NodeRecord>,
    /// The folder that it was read from.
    #[serde(skip)]
    pub run_dir: Option<PathBuf>,
}

/// The machine of a run.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Host {
    /// Its name.
    pub name: String,
    /// The number of its cores.
    pub cores: usize,
    /// Its operating system and architecture.
    pub system: String,
}

impl Manifest {
    /// The manifest of a run that starts.
    pub(crate) fn begin(
        (run, number): (&str, u64),
        graph: &Graph,
        wanted: &[bool],
        text: &str,
        argv: &[String],
    ) -> Self {
        let nodes = graph.nodes.iter().zip(wanted).filter(|(_, wanted)| **wanted);
        let record =
            |node: &Node| NodeRecord { about: NodeDescription::of(node, graph), outcome: NodeOutcome::pending() };
        Self {
            number: Some(number),
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
            started: utc::now(),
            wall_secs: 0.0,
            node_secs: 0.0,
            recorder_secs: 0.0,
            nodes: nodes.map(|(node, _)| record(node)).collect(),
            run_dir: None,
        }
    }

    /// Whether it has a digest over its own text, so that [`Manifest::read`] has seen that it is undamaged.
    pub fn is_sealed(&self) -> bool {
        self.format != UNSEALED
    }

    /// The record of the node with this name.
    pub fn node(&self, name: &str) -> Option<&NodeRecord> {
        self.nodes.iter().find(|record| record.about.name == name)
    }

    /// The readable key of a node, with every input whose content is known.
    pub fn key_of(&self, record: &NodeRecord) -> Value {
        let output = |name: &String| {
            let output = self.node(name).and_then(|source| source.outcome.output);
            output.map_or(Value::Null, |digest| Value::from(digest.to_string()))
        };
        let inputs: Map<_, _> = record
            .about
            .inputs
            .iter()
            .filter(|(_, sources)| !sources.is_empty())
            .map(|(port, sources)| (port.clone(), sources.iter().map(output).collect()))
            .collect();
        key::with_inputs(&record.about.work, Value::Object(inputs))
    }

    /// Makes the graph of the run again from the manifest alone.
    ///
    /// # Errors
    /// The run used a kind, a version or a platform that this carl-pipe does not have.
    pub fn graph(&self, kind: &dyn Fn(&str) -> Option<&'static Kind>) -> anyhow::Result<Graph> {
        let mut nodes: Vec<Node> = Vec::new();
        for record in &self.nodes {
            nodes.push(self.node_of(&record.about, &nodes, kind)?);
        }
        let (name, description) = (self.pipeline.clone(), self.description.clone());
        Ok(Graph { name, description, members: self.members.clone(), nodes })
    }

    /// The node that a description describes; `before` are the nodes that it may take.
    fn node_of(
        &self,
        description: &NodeDescription,
        before: &[Node],
        kind: &dyn Fn(&str) -> Option<&'static Kind>,
    ) -> anyhow::Result<Node> {
        let NodeDescription { name, work, .. } = description;
        let kind = kind(&work.kind).with_context(|| format!("this carl-pipe has no kind `{}`", work.kind))?;
        if kind.version != work.version {
            bail!("`{}` is now version {}, the run had version {}", work.kind, kind.version, work.version);
        }
        if work.platform != num::PLATFORM {
            bail!("`{name}` ran on platform {}, this carl-pipe has {}", work.platform, num::PLATFORM);
        }
        let kind = kind.declared(&work.params, description.inputs.keys().map(String::as_str));
        let inputs = kind.ports.iter().map(|port| Ok((port, sources(description, port, before)?)));
        let file =
            |NamedFile { path, content }| NodeFile { content, place: self.place(description.member, &path, content) };
        let files = (kind.files)(&work.params).with_context(|| format!("the parameters of `{name}` cannot be read"))?;
        Ok(Node {
            name: name.clone(),
            stage: description.stage.clone(),
            member: description.member,
            round: description.round,
            point: description.point.clone(),
            kind,
            params: work.params.clone(),
            task: work.task.clone(),
            files: files.into_iter().map(file).collect(),
            stream: work.stream.clone(),
            platform: num::PLATFORM,
            inputs: inputs.collect::<anyhow::Result<_>>()?,
            is_last: description.is_last,
        })
    }

    /// Where a file lies that a node names: the copy that the run kept, or else the file itself.
    fn place(&self, member: usize, path: &str, content: Digest) -> PathBuf {
        let kept = self.run_dir.as_ref().map(|run_dir| named_files::kept(run_dir, content));
        let file = Path::new(&self.members[member].file).parent().unwrap_or(Path::new("")).join(path);
        kept.filter(|kept| kept.exists()).unwrap_or(file)
    }
}

/// The nodes that a port takes.
fn sources(description: &NodeDescription, port: &Port, before: &[Node]) -> anyhow::Result<Vec<NodeId>> {
    let names = description.inputs.get(port.name).map_or(&[][..], Vec::as_slice);
    let position = |name: &String| before.iter().position(|node| node.name == *name);
    let sources: Option<Vec<NodeId>> = names.iter().map(position).collect();
    sources.with_context(|| format!("the manifest lacks an input of `{}`", description.name))
}

fn this_host() -> Host {
    Host {
        name: fs::read_to_string("/proc/sys/kernel/hostname")
            .map_or_else(|_| String::new(), |name| name.trim().to_owned()),
        cores: std::thread::available_parallelism().map_or(1, usize::from),
        system: format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
    }
}
