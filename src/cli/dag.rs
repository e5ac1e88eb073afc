//! `carl-pipe dag` prints the graph of a pipeline. `carl-pipe stages` describes the kinds of stages.

use serde_json::json;

use super::{
    exit::{Error, Exit},
    file::{self, PipelineArgs},
    out,
};
use crate::{diag::instead, env::Task, pipeline, stage::Kind};

/// The arguments of `dag`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    file: PipelineArgs,
    /// Print every node instead of every stage.
    #[arg(long, conflicts_with = "mermaid")]
    expand: bool,
    /// Print a Mermaid diagram, for Markdown pages.
    #[arg(long)]
    mermaid: bool,
}

/// The arguments of `stages`.
#[derive(Debug, clap::Args)]
pub(crate) struct StagesArgs {
    /// Describe only this kind.
    #[arg(value_name = "KIND")]
    kind: Option<String>,
    /// The task whose defaults are shown.
    #[arg(long, value_name = "ENV", default_value = "planar", value_parser = task)]
    task: Task,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// The task of an environment, with its default options.
fn task(env: &str) -> Result<Task, String> {
    serde_json::from_value(json!({"env": env})).map_err(|error| error.to_string())
}

/// Prints a graph.
pub(crate) fn dag(args: &Args, kinds: &'static [Kind]) -> Result<Exit, Error> {
    let graph = file::load(&args.file.pipeline, &args.file.changes, kinds, false)?.graph;
    out::print(&match (args.mermaid, args.expand) {
        (true, _) => pipeline::dag_mermaid(&graph),
        (_, true) => pipeline::dag_text_expanded(&graph),
        _ => pipeline::dag_text(&graph),
    });
    Ok(Exit::Ok)
}

/// Prints the descriptions of kinds.
pub(crate) fn stages(args: &StagesArgs, kinds: &'static [Kind]) -> Result<Exit, Error> {
    let wanted = match &args.kind {
        None => kinds,
        Some(name) => match kinds.iter().find(|kind| kind.name == name) {
            Some(kind) => std::slice::from_ref(kind),
            None => {
                let help = instead(name, "kinds", kinds.iter().map(|kind| kind.name));
                return Err(Error::usage(format!("there is no kind `{name}`")).help(help));
            }
        },
    };
    if args.json {
        let kinds = pipeline::stages_json(wanted, &args.task);
        out::json(&json!({"version": 1, "kinds": kinds}));
    } else {
        out::print(&pipeline::stages_text(wanted, &args.task));
    }
    Ok(Exit::Ok)
}
