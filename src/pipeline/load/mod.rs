//! Files in, graph out: reads a pipeline with the file that it extends, or a suite with its pipelines, and runs the
//! passes on each of them.

mod extends;
mod files;
mod single;
mod suite;

use super::{
    graph::node::Graph,
    syntax::{arguments::Overrides, document::document},
};
use crate::{
    diag::{Diagnostic, Diagnostics},
    stage::{Kind, NothingOutside, Outside},
};
use files::Files;

pub use files::{Reader, Source};

/// Reads a pipeline file that needs no other file, changed by the command line, and unrolls it into nodes.
///
/// # Errors
/// All mistakes of the file and the arguments at once. A syntax error stops the reading.
pub fn load(source: &Source, overrides: &Overrides, kinds: &'static [Kind]) -> Result<Graph, Diagnostics> {
    load_with(source, overrides, kinds, &|_| Err("no other file can be read here".to_owned()), &NothingOutside)
}

/// Reads a pipeline file with the file that it extends, or a suite with its pipelines. Files that parameters name are
/// looked up in `outside`, whose paths count from the folder of the file that is loaded.
///
/// # Errors
/// All mistakes of all files and the arguments at once.
pub fn load_with(
    source: &Source,
    overrides: &Overrides,
    kinds: &'static [Kind],
    read: Reader<'_>,
    outside: &dyn Outside,
) -> Result<Graph, Diagnostics> {
    let mut files = Files::new(read, outside);
    let loaded = graph_of(source, overrides, kinds, &mut files);
    loaded.map_err(|mistakes| Diagnostics::new(files.sources, mistakes))
}

fn graph_of(
    source: &Source,
    overrides: &Overrides,
    kinds: &'static [Kind],
    files: &mut Files<'_>,
) -> Result<Graph, Vec<Diagnostic>> {
    let mut mistakes = Vec::new();
    let file = files.add(source, "");
    match document(&file.bytes, file.base, &mut mistakes) {
        None => Err(mistakes),
        Some(table) if table.contains("suite") => suite::load(table, &file, overrides, kinds, files, mistakes),
        Some(table) => single::load(table, &file, overrides, kinds, files, mistakes),
    }
}
