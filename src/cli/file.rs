//! Reads the pipeline file that a verb names, and selects nodes of its graph.

use std::{
    cell::RefCell,
    fs,
    path::{Path, PathBuf},
};

use serde_json::json;

use super::{
    disk::Disk,
    exit::{Error, Exit, Message},
    out,
};
use crate::{
    diag::nearest,
    pipeline::{self, Graph, Overrides, Source},
    run::plan::select,
    stage::Kind,
};

/// The pipeline file and its overrides on the command line.
#[derive(Debug, clap::Args)]
pub(crate) struct PipelineArgs {
    /// The pipeline file.
    #[arg(value_name = "PIPELINE", value_hint = clap::ValueHint::FilePath)]
    pub(crate) pipeline: PathBuf,
    #[command(flatten)]
    pub(crate) changes: ChangeArgs,
}

/// The overrides of a pipeline file on the command line.
#[derive(Debug, clap::Args)]
pub(crate) struct ChangeArgs {
    /// Override a value of the file, such as `represent.epochs=20` or `seed=1`; repeatable.
    #[arg(short = 'S', long = "set", value_name = "PATH=VALUE")]
    set: Vec<String>,
    /// Run once for each value, such as `seed=0..5` or `represent.lambda.consistency=7,11`; repeatable.
    #[arg(long, value_name = "PATH=VALUES")]
    sweep: Vec<String>,
}

/// A pipeline file that was read: its text and its graph.
#[derive(Debug)]
pub(crate) struct Loaded {
    /// Every file that was read.
    pub(crate) files: Vec<PathBuf>,
    pub(crate) text: String,
    pub(crate) graph: Graph,
}

/// Reads a pipeline file. Mistakes in the file go to standard output too if `json` is true.
pub(crate) fn load(path: &Path, changes: &ChangeArgs, kinds: &'static [Kind], json: bool) -> Result<Loaded, Error> {
    let shown = path.display().to_string();
    let bytes = fs::read(path).map_err(|error| unreadable(path, &error))?;
    let overrides = Overrides { set: changes.set.clone(), sweep: changes.sweep.clone() };
    let folder = path.parent().unwrap_or(Path::new(""));
    let source = Source::new(shown, bytes).in_folder(folder);
    let files = RefCell::new(vec![path.to_owned()]);
    let read = |path: &str| {
        let path = folder.join(path);
        files.borrow_mut().push(path.clone());
        let bytes = fs::read(&path).map_err(|error| out::tidy(&error.to_string()))?;
        let folder = path.parent().unwrap_or(Path::new(""));
        Ok(Source::new(path.display().to_string(), bytes).in_folder(folder))
    };
    let disk = Disk::new(folder);
    let loaded = pipeline::load_with(&source, &overrides, kinds, &read, &disk);
    files.borrow_mut().extend(disk.into_seen());
    match loaded {
        Ok(graph) => {
            let text = String::from_utf8_lossy(&source.bytes).into_owned();
            Ok(Loaded { files: files.into_inner(), text, graph })
        }
        Err(mistakes) => {
            if json {
                out::json(&json!({"version": 1, "mistakes": mistakes.to_json()}));
            }
            let text = Message::Rendered(mistakes.render(true));
            Err(Error { exit: Exit::PipelineInvalid, text, help: None })
        }
    }
}

fn unreadable(path: &Path, error: &std::io::Error) -> Error {
    let failure = Error::usage(format!("cannot read pipeline {}: {error}", path.display()));
    let files = fs::read_dir("pipelines").into_iter().flatten().flatten().map(|item| item.path());
    let known: Vec<String> =
        files.filter(|file| file.extension().is_some_and(|ext| ext == "toml")).map(|file| stem(&file)).collect();
    if let Some(near) = nearest(&stem(path), known.iter().map(String::as_str)) {
        return failure.help(format!("did you mean `pipelines/{near}.toml`?"));
    }
    if known.is_empty() {
        return failure;
    }
    let known: Vec<String> = known.iter().map(|stem| format!("`pipelines/{stem}.toml`")).collect();
    failure.help(format!("pipelines: {}", known.join(", ")))
}

/// The name of a file without its ending.
fn stem(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

/// The nodes that the targets name and the nodes that these need. The result has one flag for each node of the graph.
pub(crate) fn pick(graph: &Graph, targets: &[String]) -> Result<Vec<bool>, Error> {
    select(graph, targets).map_err(|unknown| no_such_node(graph, &unknown))
}

/// The error for a name that is neither a stage nor a node.
pub(crate) fn no_such_node(graph: &Graph, unknown: &str) -> Error {
    let failure = Error::usage(format!("`{}` has no stage or node `{unknown}`", graph.name));
    let members = graph.members.iter().map(|member| member.name.as_str());
    let nodes = graph.nodes.iter();
    let bare = nodes.clone().filter_map(|node| Some(node.stage.split_once('/')?.1));
    let names = members.chain(bare).chain(nodes.flat_map(|node| [node.stage.as_str(), node.name.as_str()]));
    match nearest(unknown, names) {
        Some(name) => failure.help(format!("did you mean `{name}`?")),
        None => failure.help(format!("`carl-pipe dag` shows the nodes of `{}`", graph.name)),
    }
}
