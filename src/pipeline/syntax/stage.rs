//! One `[stages.name]`: `kind`, `inputs`, `loop`, `first` and `stream` are taken out, the rest is the kind's parameters.

use super::{
    parsed::{ParsedInput, ParsedKind, ParsedStage},
    reference::{ParsedReference, reference},
    tree::{Key, Table, Tree, Value},
    values,
};
use crate::{
    diag::{Diagnostic, Span},
    pipeline::messages::{found, wrong_type},
};

/// Reads a stage.
pub(super) fn stage(name: Key, mut table: Table, has_loop: bool, mistakes: &mut Vec<Diagnostic>) -> ParsedStage {
    let kind = kind(table.take("kind"), mistakes);
    let count = mistakes.len();
    let from = from(table.take("loop"), mistakes);
    let loop_broken = mistakes.len() > count || (from.is_some() && !has_loop);
    let first = first(table.take("first"), &name, from, mistakes);
    let stream = stream(table.take("stream"), mistakes);
    let written = table.take("inputs");
    let is_written = written.is_some();
    let inputs = values::table(written, "inputs", mistakes);
    let inputs_broken = is_written && inputs.is_none();
    let inputs = inputs.map_or_else(Vec::new, |(table, _)| {
        table.into_iter().map(|entry| input(entry.key, entry.value, mistakes)).collect()
    });
    ParsedStage { name, kind, params: table, first, from, loop_broken, stream, inputs, inputs_broken }
}

fn kind(value: Option<Tree>, mistakes: &mut Vec<Diagnostic>) -> ParsedKind {
    let Some(value) = value else { return ParsedKind::Missing };
    match values::text(Some(value), "kind", mistakes) {
        Some((name, span)) => ParsedKind::Named(Key::new(name, span)),
        None => ParsedKind::Unreadable,
    }
}

/// The first round: `loop = true` or `loop = { from = 1 }`.
fn from(value: Option<Tree>, mistakes: &mut Vec<Diagnostic>) -> Option<u32> {
    match value? {
        Tree { value: Value::Boolean(in_loop), .. } => in_loop.then_some(0),
        Tree { value: Value::Table(mut table), .. } => {
            let from = table.take("from");
            for key in table.keys() {
                let mistake = Diagnostic::at(key.span.clone(), format!("`loop` has no `{}`", key.text));
                mistakes.push(mistake.help("write `loop = { from = 1 }`"));
            }
            Some(values::whole(from, "from", mistakes).map_or(0, |(from, _)| from))
        }
        other => {
            let mistake = wrong_type("loop", "true or a table", &other);
            mistakes.push(mistake.help("write `loop = true` or `loop = { from = 1 }`"));
            None
        }
    }
}

fn first(value: Option<Tree>, stage: &Key, from: Option<u32>, mistakes: &mut Vec<Diagnostic>) -> Option<Table> {
    let (first, span) = values::table(value, "first", mistakes)?;
    if from.is_none() {
        let message = format!("`{}` is not in the loop, so it has no first round", stage.text);
        let mistake = Diagnostic::at(span, message);
        mistakes.push(mistake.help("write `loop = true`, or set the parameters themselves"));
    }
    Some(first)
}

fn stream(value: Option<Tree>, mistakes: &mut Vec<Diagnostic>) -> Option<String> {
    let (stream, span) = values::text(value, "stream", mistakes)?;
    if stream.is_empty() {
        let mistake = Diagnostic::at(span, "the stream has no name");
        mistakes.push(mistake.help("write a word such as `stream = \"second\"`, or leave it out"));
    }
    Some(stream)
}

fn input(port: Key, value: Tree, mistakes: &mut Vec<Diagnostic>) -> ParsedInput {
    let count = mistakes.len();
    let written = match value {
        Tree { value: Value::List(items), .. } => items,
        one => vec![one],
    };
    let references = written.iter().filter_map(|item| {
        let read = match &item.value {
            Value::Text(text) => reference(text, item.span.clone()),
            other => Err(no_reference(&port.text, other, item.span.clone())),
        };
        read.map_err(|mistake| mistakes.push(mistake)).ok()
    });
    let references: Vec<ParsedReference> = references.collect();
    ParsedInput { port, references, broken: mistakes.len() > count }
}

fn no_reference(port: &str, value: &Value, span: Span) -> Diagnostic {
    let message = format!("input `{port}` takes the name of a stage, but is {}", found(value));
    Diagnostic::at(span, message).help(format!("write `{port} = \"stage\"` or `{port} = [\"one\", \"two@prev\"]`"))
}
