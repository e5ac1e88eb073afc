//! Text to [`Draft`]: the top level of a pipeline file.

use std::collections::BTreeMap;

use toml::{
    Spanned,
    de::{DeTable, DeValue, ValueDeserializer},
};

use super::{
    draft::{Axis, Draft, Target, TaskTable},
    matrix::{self, WrittenAxis},
    stage_table,
    tree::{Key, Tree, endless_entry, endless_key, refuse_infinite_in, to_json},
    wording::{instead, of_serde, what},
};
use crate::{
    diag::{Diagnostic, Sources, Span, line_and_column},
    stage::{Kind, Preset},
};

/// The version of the file format.
const SCHEMA: i64 = 1;
/// What a file may hold at its top level.
const KEYS: [&str; 10] =
    ["schema", "name", "description", "labels", "seed", "preset", "task", "loop", "stages", "matrix"];
/// Names that paths of axes and of `-S` mean otherwise.
const RESERVED: [&str; 4] = ["seed", "preset", "task", "rounds"];
/// Beyond this a file is no pipeline.
const MAX_BYTES: usize = 4 << 20;

/// The TOML of a file with its places; numbers that are not finite are gone and reported later.
pub(super) fn document<'i>(bytes: &[u8], sources: &'i Sources) -> Result<DeTable<'i>, Vec<Diagnostic>> {
    if let Err(error) = std::str::from_utf8(bytes) {
        let at = error.valid_up_to();
        let line = line_and_column(&String::from_utf8_lossy(&bytes[..at]), at).0;
        let mistake = Diagnostic::at(at..at + 1, format!("not UTF-8: byte {at} (0x{:02x}), in line {line}", bytes[at]));
        return Err(vec![mistake.help("save the file as UTF-8 text")]);
    }
    let text = sources.texts().next().map_or("", |(_, text)| text);
    if text.trim().is_empty() {
        return Err(vec![Diagnostic::at(0..0, "the file is empty").help("begin with `schema = 1` and `name = \"…\"`")]);
    }
    if text.len() > MAX_BYTES {
        return Err(vec![Diagnostic::general(format!("the file is too large: {} bytes", text.len()))]);
    }
    let endless = |span| vec![Diagnostic::at(span, "nested too deeply").help("no parameter lies that deep")];
    if let Some(span) = endless_key(text) {
        return Err(endless(span));
    }
    let parsed = DeTable::parse(text).map_err(|error| {
        let span = error.span().unwrap_or(0..0);
        let message = error.message().lines().next().unwrap_or_default();
        vec![match message {
            "duplicate key" => Diagnostic::at(span, "the key is given twice").help("keep one of the two"),
            message => Diagnostic::at(span, format!("not TOML: {message}")),
        }]
    })?;
    match endless_entry(parsed.get_ref()) {
        Some(span) => Err(endless(span)),
        None => Ok(parsed.into_inner()),
    }
}

/// Reads the top level, and everything below it.
pub(super) fn draft<'i>(
    mut document: DeTable<'i>,
    axes: Vec<WrittenAxis<'i>>,
    ranges: &'i [Option<String>],
    sources: &Sources,
    kinds: &'static [Kind],
    mistakes: &mut Vec<Diagnostic>,
) -> Draft<'i> {
    refuse_infinite_in(&mut document, mistakes);
    for key in document.keys().filter(|key| !KEYS.contains(&key.get_ref().as_ref())) {
        mistakes.push(unknown_key(key, &document));
    }
    check_schema(document.remove("schema"), mistakes);
    let name = text_of(document.remove("name"), "name", mistakes);
    if let Some((name, span)) = &name {
        check_name(name, span, "pipeline", mistakes);
    }
    let description = text_of(document.remove("description"), "description", mistakes);
    let labels = labels_of(document.remove("labels"), mistakes);
    let seed = typed(document.remove("seed"), "seed", mistakes).unwrap_or(0);
    let preset = typed(document.remove("preset"), "preset", mistakes).unwrap_or(Preset::Recipe);
    let no_task = !document.contains_key("task");
    let task = table_of(document.remove("task"), "task", mistakes).map(|(table, span)| TaskTable { table, span });
    let rounds = rounds_of(document.remove("loop"), mistakes);
    let (rounds, rounds_span) = rounds.map_or((None, None), |(rounds, span)| (Some(rounds), Some(span)));
    let tables = stage_tables(document.remove("stages"), mistakes);
    let stages = stage_table::read(tables, rounds, kinds, mistakes);
    let axes = matrix::read(axes, ranges, sources, &stages, mistakes);
    let task = if no_task { task_of_axes(&axes, mistakes) } else { task };
    Draft {
        name: name.unwrap_or_default().0,
        description: description.unwrap_or_default().0,
        labels,
        seed,
        preset,
        task,
        rounds: rounds.unwrap_or(0),
        rounds_span,
        stages,
        axes,
    }
}

/// The task of a file that leaves it to the axes of the matrix.
fn task_of_axes<'i>(axes: &[Axis<'i>], mistakes: &mut Vec<Diagnostic>) -> Option<TaskTable<'i>> {
    let axis = axes.iter().find(|axis| matches!(axis.target, Target::Task(_)));
    if axis.is_none() {
        let mistake = Diagnostic::at(0..0, "the pipeline has no `[task]`");
        mistakes.push(mistake.help("write `[task]` with `env = \"planar\"`"));
    }
    axis.map(|axis| TaskTable { table: DeTable::new(), span: axis.span.clone() })
}

fn unknown_key(key: &Key<'_>, document: &DeTable<'_>) -> Diagnostic {
    let name = key.get_ref().as_ref();
    let mistake = Diagnostic::at(key.span(), format!("a pipeline has no `{name}`"));
    let looks_like_stage = matches!(document.get(name).map(Spanned::get_ref),
        Some(DeValue::Table(table)) if table.contains_key("kind"));
    if looks_like_stage {
        return mistake.help(format!("a stage is written `[stages.{name}]`"));
    }
    mistake.help(instead(name, "a pipeline has", KEYS.into_iter().chain(["suite"])))
}

pub(super) fn check_schema(value: Option<Tree<'_>>, mistakes: &mut Vec<Diagnostic>) {
    let help = format!("write `schema = {SCHEMA}`");
    match value {
        None => mistakes.push(Diagnostic::at(0..0, "the file does not say its `schema`").help(help)),
        Some(value) if to_json(value.get_ref()) == SCHEMA => {}
        Some(value) => {
            let shown = to_json(value.get_ref());
            let mistake = Diagnostic::at(value.span(), format!("schema `{shown}` is not one this version reads"));
            mistakes.push(mistake.help(help));
        }
    }
}

/// A name must fit into references, node names and file names.
pub(super) fn check_name(name: &str, span: &Span, what: &str, mistakes: &mut Vec<Diagnostic>) {
    if name.is_empty() || !name.bytes().all(|byte| byte.is_ascii_alphanumeric() || matches!(byte, b'_' | b'-')) {
        let mistake = Diagnostic::at(span.clone(), format!("`{name}` is no name for a {what}"));
        mistakes.push(mistake.help("a name holds letters a to z, digits, `_` and `-`"));
    } else if ["stage", "member of a suite"].contains(&what) && RESERVED.contains(&name) {
        let mistake = Diagnostic::at(span.clone(), format!("a {what} cannot be called `{name}`"));
        mistakes.push(mistake.help(format!("`-S {name}=…` would mean two things; choose another name")));
    }
}

/// `[labels]`: free texts and numbers about a pipeline, which no key holds.
pub(super) fn labels_of(value: Option<Tree<'_>>, mistakes: &mut Vec<Diagnostic>) -> BTreeMap<String, String> {
    let table = table_of(value, "labels", mistakes).map(|(table, _)| table).unwrap_or_default();
    let mut labels = BTreeMap::new();
    for (key, value) in table {
        let text = match value.get_ref() {
            DeValue::String(text) => text.to_string(),
            DeValue::Integer(_) | DeValue::Float(_) | DeValue::Boolean(_) => to_json(value.get_ref()).to_string(),
            other => {
                let message = format!("the label `{}` cannot be {}", key.get_ref(), what(other));
                mistakes.push(Diagnostic::at(value.span(), message).help("a label is a text or a number"));
                continue;
            }
        };
        labels.insert(key.get_ref().to_string(), text);
    }
    labels
}

pub(super) fn text_of(value: Option<Tree<'_>>, key: &str, mistakes: &mut Vec<Diagnostic>) -> Option<(String, Span)> {
    let Some(value) = value else {
        if key == "name" {
            let mistake = Diagnostic::at(0..0, "the file has no `name`");
            mistakes.push(mistake.help("write `name = \"planar_online\"`"));
        }
        return None;
    };
    let span = value.span();
    typed(Some(value), key, mistakes).map(|text| (text, span))
}

/// A value of a type that serde knows.
pub(super) fn typed<T: serde::de::DeserializeOwned>(
    value: Option<Tree<'_>>,
    key: &str,
    mistakes: &mut Vec<Diagnostic>,
) -> Option<T> {
    let value = value?;
    let span = value.span();
    match T::deserialize(ValueDeserializer::from(value)) {
        Ok(value) => Some(value),
        Err(error) => {
            mistakes.push(of_serde(error.message(), span, "the pipeline", Some(key)));
            None
        }
    }
}

/// A table and its place.
pub(super) fn table_of<'i>(
    value: Option<Tree<'i>>,
    key: &str,
    mistakes: &mut Vec<Diagnostic>,
) -> Option<(DeTable<'i>, Span)> {
    let value = value?;
    let span = value.span();
    match value.into_inner() {
        DeValue::Table(table) => Some((table, span)),
        other => {
            let message = format!("`{key}` takes a table, but is {}", what(&other));
            mistakes.push(Diagnostic::at(span, message));
            None
        }
    }
}

/// The number of rounds and where it stands. After a mistake it is one, which lets the other checks go on.
fn rounds_of(value: Option<Tree<'_>>, mistakes: &mut Vec<Diagnostic>) -> Option<(u32, Span)> {
    let (mut table, span) = table_of(value, "loop", mistakes)?;
    let rounds = table.remove("rounds");
    for key in table.keys() {
        let message = format!("`[loop]` has no `{}`", key.get_ref());
        mistakes.push(Diagnostic::at(key.span(), message).help("a loop has: rounds"));
    }
    let Some(rounds) = rounds else {
        mistakes.push(Diagnostic::at(span.clone(), "`[loop]` needs `rounds`").help("write `rounds = 17`"));
        return Some((1, span));
    };
    let at = rounds.span();
    match typed::<u32>(Some(rounds), "rounds", mistakes) {
        Some(0) => {
            let mistake = Diagnostic::at(at.clone(), "a loop has at least one round");
            mistakes.push(mistake.help("write `rounds = 1` or more"));
            Some((1, at))
        }
        other => Some((other.unwrap_or(1), at)),
    }
}

fn stage_tables<'i>(value: Option<Tree<'i>>, mistakes: &mut Vec<Diagnostic>) -> Vec<(Key<'i>, Span, DeTable<'i>)> {
    let wrong = value.as_ref().is_some_and(|value| !value.get_ref().is_table());
    let stages = table_of(value, "stages", mistakes).map(|(table, _)| table).unwrap_or_default();
    if stages.is_empty() && !wrong {
        let mistake = Diagnostic::at(0..0, "the pipeline has no stages");
        mistakes.push(mistake.help("write `[stages.name]` with `kind = \"…\"`"));
    }
    let mut tables = Vec::new();
    for (key, value) in stages {
        check_name(key.get_ref(), &key.span(), "stage", mistakes);
        if let Some((table, span)) = table_of(Some(value), key.get_ref(), mistakes) {
            tables.push((key, span, table));
        }
    }
    tables
}
