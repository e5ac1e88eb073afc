//! `carl-pipe export-policy`: writes a trained policy as one ONNX file, from pictures to actions.

use std::path::PathBuf;

use anyhow::Context as _;
use serde_json::json;

use super::{
    Global,
    exit::{Error, Exit},
    finished_node::{files, finished},
    out,
    output::refuse_inputs,
};
use crate::{
    artifact::{Artifact, TrainedModel},
    control::Agent,
    onnx,
    report::outcomes::is_done,
    run::{manifest::Manifest, node::NodeRecord},
    stage::Kind,
    store,
};

/// The arguments of `export-policy`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The run, such as `latest`, or RUN/NODE for the policy that a node evaluates or makes; the last evaluation if
    /// no node is given.
    #[arg(value_name = "RUN[/NODE]", default_value = "latest")]
    policy: String,
    /// The file to write.
    #[arg(short, long, value_name = "FILE.onnx", default_value = "policy.onnx")]
    output: PathBuf,
}

/// Exports a policy.
pub(crate) fn export_policy(global: &Global, args: &Args, kinds: &'static [Kind]) -> Result<Exit, Error> {
    let (run, node) = args.policy.split_once('/').map_or((&*args.policy, None), |(run, node)| (run, Some(node)));
    let manifest = global.manifest(run)?;
    let node = match node {
        Some(node) => finished(&manifest, node)?,
        None => evaluated(&manifest)?,
    };
    refuse_inputs(&args.output, &[], &global.artifacts).map_err(|error| Error::usage(error.to_string()))?;
    let gives_agent = node.about.work.kind_among(kinds).is_some_and(|kind| kind.gives(Agent::TYPE));
    let agent_node = if gives_agent { node } else { input(&manifest, node, "agent")? };
    let model_node = input(&manifest, node, "model")?;
    let agent: Agent = load(global, agent_node)?;
    let TrainedModel { model, .. } = load(global, model_node)?;
    let task = &node.about.work.task;
    let spec = task.spec();
    let picture = spec.frames.observation();
    let about = [
        ("task", json!(task).to_string()),
        ("run", manifest.run.clone()),
        ("model", model_node.about.name.clone()),
        ("agent", agent_node.about.name.clone()),
        ("frames", spec.frames.count.to_string()),
        ("channels", spec.frames.channels.to_string()),
        ("action_limit", json!(spec.action_limit).to_string()),
    ];
    let bytes = onnx::export(&model, &agent, picture, &about)
        .with_context(|| format!("cannot export the policy of `{}`", node.about.name))?;
    store::replace_file(&args.output, &bytes, false)?;
    let (rows, columns) = picture;
    out::line(&format!(
        "{}: `{}` on codes of `{}`, from pictures of {rows} x {columns} to {} numbers from -1 to 1",
        args.output.display(),
        agent_node.about.name,
        model_node.about.name,
        agent.action
    ));
    Ok(Exit::Ok)
}

/// The last finished node that takes a model and an agent.
fn evaluated(manifest: &Manifest) -> Result<&NodeRecord, Error> {
    let takes = |node: &&NodeRecord| ["model", "agent"].iter().all(|port| !sources(node, port).is_empty());
    let last = manifest.nodes.iter().rev().filter(|node| is_done(node)).find(takes);
    last.ok_or_else(|| {
        Error::usage(format!("run {} has no finished node that takes a model and an agent", manifest.run))
            .help("name a node, as in `latest/control`; policies of iLQR and SOLAR cannot be exported")
    })
}

fn sources<'a>(node: &'a NodeRecord, port: &str) -> &'a [String] {
    node.about.inputs.get(port).map_or(&[], Vec::as_slice)
}

/// The node that a node takes by a port.
fn input<'a>(manifest: &'a Manifest, node: &NodeRecord, port: &str) -> Result<&'a NodeRecord, Error> {
    let source = sources(node, port).first().and_then(|name| manifest.node(name));
    source.ok_or_else(|| {
        Error::usage(format!("`{}` has no input `{port}`, so it has no policy of an agent", node.about.name))
            .help("name a node that evaluates or makes an agent, as in `latest/control`")
    })
}

fn load<A: Artifact>(global: &Global, node: &NodeRecord) -> Result<A, Error> {
    let files = files(global, node)?;
    Ok(A::load(&files).with_context(|| format!("cannot read the output of `{}`", node.about.name))?)
}
