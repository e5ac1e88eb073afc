//! A document to a parsed pipeline: the top level of the file, and everything below it.

use std::collections::BTreeMap;

use super::{
    arguments::Changes,
    matrix,
    parsed::{ParsedPipeline, ParsedStage, ParsedTask, Rounds, TaskTable},
    stage,
    tree::{Key, Table, Tree, Value},
    values,
};
use crate::{
    diag::{Diagnostic, Sources, Span, instead},
    pipeline::messages::{found, wrong_type},
    stage::Preset,
};

/// The keys of the top level.
const KEYS: [&str; 11] =
    ["schema", "extends", "name", "description", "labels", "seed", "preset", "task", "loop", "stages", "matrix"];

/// Reads a document that arguments and base are already applied to. `start` is the place of what the file lacks.
pub(crate) fn pipeline(
    mut document: Table,
    changes: Changes,
    start: &Span,
    sources: &Sources,
    mistakes: &mut Vec<Diagnostic>,
) -> ParsedPipeline {
    for key in document.keys().filter(|key| !KEYS.contains(&key.text.as_str())) {
        mistakes.push(unknown_key(key, &document));
    }
    values::check_schema(document.take("schema"), start, mistakes);
    let name = values::name(document.take("name"), "pipeline", start, mistakes).unwrap_or_default();
    let description = values::text(document.take("description"), "description", mistakes);
    let labels = labels(document.take("labels"), mistakes);
    let seed = values::whole(document.take("seed"), "seed", mistakes).map_or(0, |(seed, _)| seed);
    let preset = values::preset(document.take("preset"), mistakes).unwrap_or(Preset::Recipe);
    let task = task(document.take("task"), mistakes);
    let rounds = rounds(document.take("loop"), mistakes);
    let stages = stages(document.take("stages"), rounds.is_some(), start, mistakes);
    let axes = matrix::axes(document.take("matrix"), changes, sources, mistakes);
    let description = description.map(|(text, _)| text).unwrap_or_default();
    ParsedPipeline { name, description, labels, seed, preset, task, rounds, stages, axes, start: start.clone() }
}

fn unknown_key(key: &Key, document: &Table) -> Diagnostic {
    let name = key.text.as_str();
    let mistake = Diagnostic::at(key.span.clone(), format!("a pipeline has no `{name}`"));
    let value = document.get(name).and_then(|tree| tree.value.as_table());
    if value.is_some_and(|table| table.contains("kind")) {
        return mistake.help(format!("a stage is written `[stages.{name}]`"));
    }
    mistake.help(instead(name, "a pipeline has", KEYS.into_iter().chain(["suite"])))
}

/// `[labels]`: free texts and numbers about a pipeline. No key of a result holds them.
fn labels(value: Option<Tree>, mistakes: &mut Vec<Diagnostic>) -> BTreeMap<String, String> {
    let table = values::table(value, "labels", mistakes).map(|(table, _)| table).unwrap_or_default();
    let mut labels = BTreeMap::new();
    for entry in table {
        let name = entry.key.text;
        match entry.value.value {
            Value::Text(text) => _ = labels.insert(name, text),
            value @ (Value::Whole(_) | Value::Fraction(_) | Value::Boolean(_)) => {
                labels.insert(name, value.to_json().to_string());
            }
            other => {
                let message = format!("the label `{name}` cannot be {}", found(&other));
                mistakes.push(Diagnostic::at(entry.value.span, message).help("a label is a text or a number"));
            }
        }
    }
    labels
}

fn task(value: Option<Tree>, mistakes: &mut Vec<Diagnostic>) -> ParsedTask {
    match value {
        None => ParsedTask::Missing,
        Some(Tree { value: Value::Table(table), span }) => ParsedTask::Written(TaskTable { table, span }),
        Some(other) => {
            mistakes.push(wrong_type("task", "a table", &other));
            ParsedTask::Unreadable
        }
    }
}

/// After a mistake there is one round, so that the other checks go on.
fn rounds(value: Option<Tree>, mistakes: &mut Vec<Diagnostic>) -> Option<Rounds> {
    let (mut table, header) = values::table(value, "loop", mistakes)?;
    let rounds = table.take("rounds");
    for key in table.keys() {
        let mistake = Diagnostic::at(key.span.clone(), format!("`[loop]` has no `{}`", key.text));
        mistakes.push(mistake.help("a loop has: rounds"));
    }
    let Some(rounds) = rounds else {
        mistakes.push(Diagnostic::at(header.clone(), "`[loop]` needs `rounds`").help("write `rounds = 17`"));
        return Some(Rounds { count: 1, span: header });
    };
    let span = rounds.span.clone();
    let count = match values::whole(Some(rounds), "rounds", mistakes) {
        Some((0, _)) => {
            let mistake = Diagnostic::at(span.clone(), "a loop has at least one round");
            mistakes.push(mistake.help("write `rounds = 1` or more"));
            1
        }
        read => read.map_or(1, |(count, _)| count),
    };
    Some(Rounds { count, span })
}

fn stages(value: Option<Tree>, has_loop: bool, start: &Span, mistakes: &mut Vec<Diagnostic>) -> Vec<ParsedStage> {
    let is_written = value.is_some();
    let table = values::table(value, "stages", mistakes).map(|(table, _)| table);
    if table.as_ref().map_or(!is_written, Table::is_empty) {
        let mistake = Diagnostic::at(start.clone(), "the pipeline has no stages");
        mistakes.push(mistake.help("write `[stages.name]` with `kind = \"…\"`"));
    }
    let mut stages = Vec::new();
    for entry in table.unwrap_or_default() {
        values::check_name(&entry.key.text, &entry.key.span, "stage", mistakes);
        if let Some((table, _)) = values::table(Some(entry.value), &entry.key.text, mistakes) {
            stages.push(stage::stage(entry.key, table, has_loop, mistakes));
        }
    }
    if let (false, Some(stage)) = (has_loop, stages.iter().find(|stage| stage.from.is_some())) {
        let message = format!("stage `{}` is in the loop, but the pipeline has none", stage.name.text);
        let mistake = Diagnostic::at(stage.name.span.clone(), message);
        mistakes.push(mistake.help("write `[loop]` with `rounds = …`, or leave `loop` out of the stages"));
    }
    stages
}
