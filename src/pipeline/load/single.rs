//! One pipeline through all passes.

use super::{
    extends::{Document, extended},
    files::{File, Files},
};
use crate::{
    diag::{Diagnostic, Sources},
    pipeline::{
        graph::{self, node::Graph},
        messages::holds_no_parameters,
        resolve::names,
        syntax::{
            arguments::{self, Argument, Changes, Overrides},
            path::PathValue,
            top_level,
            tree::{Entry, Key, Table},
        },
    },
    stage::{Kind, Outside},
};

/// Loads a pipeline that stands alone.
pub(super) fn load(
    table: Table,
    file: &File,
    overrides: &Overrides,
    kinds: &'static [Kind],
    files: &mut Files<'_>,
    mut mistakes: Vec<Diagnostic>,
) -> Result<Graph, Vec<Diagnostic>> {
    let Some(document) = extended(table, file, files, &mut mistakes) else { return Err(mistakes) };
    let arguments = Argument::all(overrides, &mut files.sources);
    let mut graph =
        graph_of(document, Additions::default(), &arguments, &files.sources, (kinds, files.outside), mistakes)?;
    graph.members[0].file.clone_from(&file.path);
    Ok(graph)
}

/// What a suite adds to a pipeline.
#[derive(Debug, Default)]
pub(super) struct Additions {
    /// The axis `seed`.
    pub(super) seeds: Option<PathValue>,
    pub(super) set: Vec<PathValue>,
    pub(super) labels: Table,
}

/// Applies additions and arguments to a document, and runs the passes on it.
pub(super) fn graph_of(
    document: Document,
    additions: Additions,
    arguments: &[Argument],
    sources: &Sources,
    (kinds, outside): (&'static [Kind], &dyn Outside),
    mut mistakes: Vec<Diagnostic>,
) -> Result<Graph, Vec<Diagnostic>> {
    let Document { mut table, start, base, programs } = document;
    let mut changes = Changes::default();
    for one in additions.set {
        let path = one.path(sources);
        mistakes.extend(arguments::set_path(&mut table, path, one.value, &mut changes).err());
    }
    for Entry { key, value } in additions.labels {
        let path = [Key::new("labels", key.span.clone()), key];
        mistakes.extend(table.set(&path, value).err().map(|key| holds_no_parameters(&key)));
    }
    changes.sweeps.extend(additions.seeds);
    arguments::apply(&mut table, arguments, &mut changes, &mut mistakes);
    let parsed = top_level::pipeline(table, changes, &start, sources, &mut mistakes);
    let resolved = names::resolve(parsed, programs, kinds, &mut mistakes);
    let mut graph = graph::graph(&resolved, outside, mistakes)?;
    graph.members[0].base = base;
    Ok(graph)
}
