//! `carl-pipe dag` and `carl-pipe stages`: what a pipeline looks like, and what it can be made of.

use super::{
    exit::{Error, Exit},
    file::{self, PipelineArgs},
    out::{self, Colour},
};
use crate::stage::Kind;
use stub as pipeline;
mod stub {
    pub(super) fn dag_text(_: &crate::pipeline::Graph) -> String { String::new() }
    pub(super) fn dag_mermaid(_: &crate::pipeline::Graph) -> String { String::new() }
    pub(super) fn stages_text(_: &[&crate::stage::Kind]) -> String { String::new() }
}

/// The arguments of `dag`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    file: PipelineArgs,
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
}

/// Draws a graph.
pub(crate) fn dag(args: &Args, kinds: &'static [Kind], colour: Colour) -> Result<Exit, Error> {
    let loaded = file::load(&args.file.pipeline, &args.file.changes, kinds, colour)?;
    let text = if args.mermaid { pipeline::dag_mermaid(&loaded.graph) } else { pipeline::dag_text(&loaded.graph) };
    out::print(&text);
    Ok(Exit::Ok)
}

/// Describes the kinds.
pub(crate) fn stages(args: &StagesArgs, kinds: &'static [Kind]) -> Result<Exit, Error> {
    let wanted: Vec<&Kind> = kinds.iter().filter(|kind| args.kind.as_ref().is_none_or(|name| kind.name == name)).collect();
    match (&args.kind, &wanted[..]) {
        (Some(name), []) => {
            let failure = Error::usage(format!("there is no kind `{name}`"));
            Err(match file::nearest(name, kinds.iter().map(|kind| kind.name)) {
                Some(near) => failure.help(format!("did you mean `{near}`?")),
                None => failure.help("`carl-pipe stages` lists them"),
            })
        }
        (_, wanted) => {
            out::print(&pipeline::stages_text(wanted));
            Ok(Exit::Ok)
        }
    }
}
