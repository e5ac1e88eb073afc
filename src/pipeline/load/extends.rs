//! `extends = "online.toml"`: a pipeline file that says only what it changes in another one, its base.
//!
//! The file is laid over its base. Tables are merged key by key, all other values are replaced, lists among them. Some
//! things differ from that rule:
//! - `schema` and `name` are not inherited.
//! - A `[stages.x]` with a `kind` and a `[task]` with an `env` are whole: they replace those of the base.
//! - An axis of `[matrix]` replaces the axis of the same path, however the two are spelled.
//!
//! `[stages]` with `x = false` leaves out the stage `x` of the base. A base stands alone: it extends no file itself.

use std::path::{Component, Path, PathBuf};

use super::files::{File, Files};
use crate::{
    diag::{Diagnostic, Span, instead},
    pipeline::{
        graph::node::BaseFile,
        syntax::{
            document::document,
            path::flatten,
            tree::{Entry, Key, Table, Tree, Value},
            values,
        },
    },
};

/// A pipeline file with its base.
#[derive(Debug, Clone)]
pub(super) struct Document {
    pub(super) table: Table,
    /// The start of the file, which is never in the base.
    pub(super) start: Span,
    pub(super) base: Option<BaseFile>,
    /// The folder of the file that names the program of the task, if it is known.
    pub(super) programs: Option<PathBuf>,
}

/// Reads the base of a file, if it has one, and lays the file over it. `None` where there is no base to read, which is
/// reported: nothing else can be said about the file then.
pub(super) fn extended(
    mut table: Table,
    file: &File,
    files: &mut Files<'_>,
    mistakes: &mut Vec<Diagnostic>,
) -> Option<Document> {
    let start = file.start();
    let programs = file.home.clone();
    let Some(value) = table.take("extends") else { return Some(Document { table, start, base: None, programs }) };
    let (path, span) = values::text(Some(value), "extends", mistakes)?;
    let base = base_file(&path, &span, file, files).map_err(|mistake| mistakes.push(mistake)).ok()?;
    let mut below = document(&base.bytes, base.base, mistakes)?;
    if let Some(mistake) = no_base(&below, &path, &span) {
        mistakes.push(mistake);
        return None;
    }
    values::check_schema(below.take("schema"), &base.start(), mistakes);
    below.take("name");
    let names_program = table.find(["task", "command"]).is_some_and(|found| found.value.as_table().is_none());
    let programs = if names_program { programs } else { base.home.clone() };
    let base = BaseFile { text: base.text(), file: base.path };
    Some(Document { table: laid_over(below, table, &path, mistakes), start, base: Some(base), programs })
}

fn base_file(path: &str, span: &Span, file: &File, files: &mut Files<'_>) -> Result<File, Diagnostic> {
    let refuse = |message: String, help: &str| Diagnostic::at(span.clone(), message).help(help);
    let base = files
        .read(&file.beside(path))
        .map_err(|why| refuse(format!("cannot read `{path}`: {why}"), "write a path from the folder of this file"))?;
    if normal(&base.path) == normal(&file.path) {
        return Err(refuse("the file extends itself".to_owned(), "name another file"));
    }
    Ok(base)
}

/// Why a file cannot be extended.
fn no_base(table: &Table, path: &str, span: &Span) -> Option<Diagnostic> {
    if table.contains("suite") {
        let mistake = Diagnostic::at(span.clone(), format!("`{path}` is a suite, which no pipeline can extend"));
        return Some(mistake.help("name one of its pipelines"));
    }
    let above = table.get("extends")?;
    let mistake = Diagnostic::at(span.clone(), format!("`{path}` extends another file itself"));
    let above = above.value.as_text().map_or_else(|| "a file".to_owned(), |above| format!("`{above}`"));
    Some(mistake.help(format!("name a file that stands alone, such as {above}, which `{path}` extends")))
}

/// The path without `.` and `..`, as far as the text tells.
fn normal(path: &str) -> PathBuf {
    let mut normal = PathBuf::new();
    for part in Path::new(path).components() {
        match part {
            Component::CurDir => {}
            Component::ParentDir if matches!(normal.components().next_back(), Some(Component::Normal(_))) => {
                normal.pop();
            }
            part => normal.push(part),
        }
    }
    normal
}

/// `path` is the base's, for messages.
fn laid_over(mut base: Table, over: Table, path: &str, mistakes: &mut Vec<Diagnostic>) -> Table {
    for Entry { key, value } in over {
        let below = base.get_mut(&key.text).map(|tree| &mut tree.value);
        match (key.text.as_str(), below, value.value.as_table()) {
            ("stages", Some(Value::Table(below)), Some(above)) => {
                lay_stages(below, above.clone(), path, mistakes);
            }
            ("matrix", Some(Value::Table(below)), Some(above)) => lay_axes(below, above.clone()),
            (name, Some(Value::Table(below)), Some(above)) if name != "task" || !above.contains("env") => {
                below.lay_over(above.clone());
            }
            _ => base.insert(key, value),
        }
    }
    base
}

fn lay_stages(below: &mut Table, above: Table, path: &str, mistakes: &mut Vec<Diagnostic>) {
    let known: Vec<String> = below.keys().map(|key| key.text.clone()).collect();
    for Entry { key, value } in above {
        if value.value == Value::Boolean(false) {
            if below.take(&key.text).is_none() {
                mistakes.push(no_stage(path, &key, &known, ""));
            }
            continue;
        }
        let is_whole = value.value.as_table().is_none_or(|stage| stage.contains("kind"));
        match (below.get_mut(&key.text).map(|tree| &mut tree.value), value.value) {
            (Some(Value::Table(below)), Value::Table(above)) if !is_whole => below.lay_over(above),
            (None, _) if !is_whole => {
                mistakes.push(no_stage(path, &key, &known, " (a new stage needs a `kind`)"));
            }
            (_, stage) => below.insert(key, Tree { value: stage, span: value.span }),
        }
    }
}

/// The mistake of naming a stage that the base does not have. `note` follows the stages that may be meant.
fn no_stage(path: &str, key: &Key, known: &[String], note: &str) -> Diagnostic {
    let help = instead(&key.text, "stages", known.iter().map(String::as_str));
    Diagnostic::at(key.span.clone(), format!("`{path}` has no stage `{}`", key.text)).help(format!("{help}{note}"))
}

fn lay_axes(below: &mut Table, above: Table) {
    let names: Vec<String> = flatten(above.clone()).iter().map(|axis| axis.name()).collect();
    let mut axes = Table::default();
    for axis in flatten(std::mem::take(below)).into_iter().filter(|axis| !names.contains(&axis.name())) {
        // Paths of one table cannot contradict each other.
        _ = axes.set(&axis.keys, axis.value);
    }
    axes.lay_over(above);
    *below = axes;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_is_compared_without_its_detours() {
        assert_eq!(normal("./a/../b/c.toml"), normal("b/c.toml"));
        assert_ne!(normal("../b/c.toml"), normal("b/c.toml"));
    }
}
