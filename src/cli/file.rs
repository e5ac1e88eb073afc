//! Reads the pipeline that a verb names, and picks nodes out of it.

use std::{
    fs,
    path::{Path, PathBuf},
};

use super::{
    exit::{Error, Exit, Message},
    out::{self, Colour},
};
use crate::{
    diag::nearest,
    pipeline::{self, Graph, Overrides, Source},
    run::plan::select,
    stage::Kind,
};

/// The pipeline file and what the command line changes in it.
#[derive(Debug, clap::Args)]
pub(crate) struct PipelineArgs {
    /// The pipeline file.
    #[arg(value_name = "PIPELINE", value_hint = clap::ValueHint::FilePath)]
    pub(crate) pipeline: PathBuf,
    #[command(flatten)]
    pub(crate) changes: ChangeArgs,
}

/// What the command line changes in a pipeline file.
#[derive(Debug, clap::Args)]
pub(crate) struct ChangeArgs {
    /// Change a value of the file, such as `represent.epochs=20` or `seed=1`; may be given again.
    #[arg(short = 'S', long = "set", value_name = "PATH=VALUE")]
    set: Vec<String>,
    /// Run for each of several values, such as `seed=0..5` or `represent.lambda.consistency=7,11`.
    #[arg(long, value_name = "PATH=VALUES")]
    sweep: Vec<String>,
}

/// A pipeline, read.
#[derive(Debug)]
pub(crate) struct Loaded {
    pub(crate) text: String,
    pub(crate) graph: Graph,
}

/// Reads a pipeline file.
pub(crate) fn load(
    path: &Path,
    changes: &ChangeArgs,
    kinds: &'static [Kind],
    colour: Colour,
    json: bool,
) -> Result<Loaded, Error> {
    let shown = path.display().to_string();
    let bytes = fs::read(path).map_err(|error| unreadable(path, &error))?;
    let overrides = Overrides { set: changes.set.clone(), sweep: changes.sweep.clone() };
    let source = Source::new(shown, bytes);
    let folder = path.parent().unwrap_or(Path::new(""));
    let read = |path: &str| {
        let path = folder.join(path);
        let bytes = fs::read(&path).map_err(|error| out::tidy(&error.to_string()))?;
        Ok(Source::new(path.display().to_string(), bytes))
    };
    match pipeline::load_with(&source, &overrides, kinds, &read) {
        Ok(graph) => Ok(Loaded { text: String::from_utf8_lossy(&source.bytes).into_owned(), graph }),
        Err(mistakes) => {
            if json {
                out::line(&serde_json::json!({"version": 1, "mistakes": mistakes.to_json()}).to_string());
            }
            let text = Message::Rendered(mistakes.render(colour.on_stderr().0));
            Err(Error { exit: Exit::PipelineInvalid, text, help: None })
        }
    }
}

fn unreadable(path: &Path, error: &std::io::Error) -> Error {
    let failure = Error::usage(format!("cannot read pipeline {}: {error}", path.display()));
    let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let there = fs::read_dir("pipelines").into_iter().flatten().flatten().map(|item| item.path());
    let files: Vec<PathBuf> = there.filter(|path| path.extension().is_some_and(|ext| ext == "toml")).collect();
    let stems: Vec<String> =
        files.iter().map(|path| path.file_stem().unwrap_or_default().to_string_lossy().into_owned()).collect();
    match nearest(&name, stems.iter().map(String::as_str)) {
        Some(stem) => failure.help(format!("did you mean `pipelines/{stem}.toml`?")),
        None if files.is_empty() => failure,
        None => failure.help(format!(
            "there are {}",
            stems.iter().map(|stem| format!("`pipelines/{stem}.toml`")).collect::<Vec<_>>().join(", ")
        )),
    }
}

/// The nodes that targets name, with all that they need.
pub(crate) fn pick(graph: &Graph, targets: &[String]) -> Result<Vec<bool>, Error> {
    select(graph, targets).map_err(|unknown| no_such_node(graph, &unknown))
}

/// A name that is neither a stage nor a node.
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
