//! `carl-pipe dag` and `carl-pipe stages`: what a pipeline looks like, and what it can be made of.

use super::{
    exit::{Error, Exit},
    file::{self, PipelineArgs},
    out::{self, Colour},
};
use crate::{diag::nearest, env::Task, pipeline, stage::Kind};

/// The arguments of `dag`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    file: PipelineArgs,
    /// Every node, not only every stage.
    #[arg(long, conflicts_with = "mermaid")]
    expand: bool,
    /// Mermaid, for Markdown pages.
    #[arg(long)]
    mermaid: bool,
}

/// The arguments of `stages`.
#[derive(Debug, clap::Args)]
pub(crate) struct StagesArgs {
    /// Only this kind.
    #[arg(value_name = "KIND")]
    kind: Option<String>,
    /// The task that defaults are shown for.
    #[arg(long, value_name = "ENV", default_value = "planar", value_parser = task)]
    task: Task,
    /// One JSON object.
    #[arg(long)]
    json: bool,
}

fn task(env: &str) -> Result<Task, String> {
    serde_json::from_value(serde_json::json!({"env": env})).map_err(|error| error.to_string())
}

/// Draws a graph.
pub(crate) fn dag(args: &Args, kinds: &'static [Kind], colour: Colour) -> Result<Exit, Error> {
    let graph = file::load(&args.file.pipeline, &args.file.changes, kinds, colour, false)?.graph;
    out::print(&match (args.mermaid, args.expand) {
        (true, _) => pipeline::dag_mermaid(&graph),
        (_, true) => pipeline::dag_text_expanded(&graph),
        _ => pipeline::dag_text(&graph),
    });
    Ok(Exit::Ok)
}

/// Describes the kinds.
pub(crate) fn stages(args: &StagesArgs, kinds: &'static [Kind]) -> Result<Exit, Error> {
    let wanted = match &args.kind {
        None => kinds,
        Some(name) => match kinds.iter().find(|kind| kind.name == name) {
            Some(kind) => std::slice::from_ref(kind),
            None => return Err(no_such_kind(name, kinds)),
        },
    };
    if args.json {
        let kinds = pipeline::stages_json(wanted, &args.task);
        out::line(&serde_json::json!({"version": 1, "kinds": kinds}).to_string());
    } else {
        out::print(&pipeline::stages_text(wanted, &args.task));
    }
    Ok(Exit::Ok)
}

fn no_such_kind(name: &str, kinds: &[Kind]) -> Error {
    let failure = Error::usage(format!("there is no kind `{name}`"));
    match nearest(name, kinds.iter().map(|kind| kind.name)) {
        Some(near) => failure.help(format!("did you mean `{near}`?")),
        None => failure.help("`carl-pipe stages` lists them"),
    }
}
