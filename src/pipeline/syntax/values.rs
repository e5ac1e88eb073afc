//! Reads a value of the type that a key takes, or reports what stands there instead.

use super::tree::{Table, Tree, Value};
use crate::{
    diag::{Diagnostic, Span, instead},
    pipeline::messages::wrong_type,
    stage::Preset,
};

/// The version of the file format.
const SCHEMA: i128 = 1;
/// Names that paths of axes and of `-S` use for other things.
const RESERVED: [&str; 4] = ["seed", "preset", "task", "rounds"];

/// A table and its place.
pub(crate) fn table(value: Option<Tree>, key: &str, mistakes: &mut Vec<Diagnostic>) -> Option<(Table, Span)> {
    match value? {
        Tree { value: Value::Table(table), span } => Some((table, span)),
        other => {
            mistakes.push(wrong_type(key, "a table", &other));
            None
        }
    }
}

/// A text and its place.
pub(crate) fn text(value: Option<Tree>, key: &str, mistakes: &mut Vec<Diagnostic>) -> Option<(String, Span)> {
    match value? {
        Tree { value: Value::Text(text), span } => Some((text, span)),
        other => {
            mistakes.push(wrong_type(key, "a text", &other));
            None
        }
    }
}

/// A whole number that is not negative, and its place.
pub(crate) fn whole<T: TryFrom<i128>>(
    value: Option<Tree>,
    key: &str,
    mistakes: &mut Vec<Diagnostic>,
) -> Option<(T, Span)> {
    let tree = value?;
    let number = match &tree.value {
        Value::Whole(number) if *number >= 0 => T::try_from(*number).ok(),
        _ => None,
    };
    if number.is_none() {
        mistakes.push(wrong_type(key, "a whole number from 0 up", &tree));
    }
    Some((number?, tree.span))
}

/// A preset.
pub(crate) fn preset(value: Option<Tree>, mistakes: &mut Vec<Diagnostic>) -> Option<Preset> {
    let (word, span) = text(value, "preset", mistakes)?;
    let preset = serde_json::from_value(word.as_str().into()).ok();
    if preset.is_none() {
        let mistake = Diagnostic::at(span, format!("`preset` cannot be `{word}`"));
        mistakes.push(mistake.help(instead(&word, "choices", ["recipe", "paper"])));
    }
    preset
}

/// The `name` of a file.
pub(crate) fn name(value: Option<Tree>, what: &str, start: &Span, mistakes: &mut Vec<Diagnostic>) -> Option<String> {
    if value.is_none() {
        let mistake = Diagnostic::at(start.clone(), "the file has no `name`");
        mistakes.push(mistake.help("write `name = \"planar_online\"`"));
    }
    let (name, span) = text(value, "name", mistakes)?;
    check_name(&name, &span, what, mistakes);
    Some(name)
}

/// Refuses a file of another format.
pub(crate) fn check_schema(value: Option<Tree>, start: &Span, mistakes: &mut Vec<Diagnostic>) {
    let help = format!("write `schema = {SCHEMA}`");
    match value {
        None => mistakes.push(Diagnostic::at(start.clone(), "the file does not say its `schema`").help(help)),
        Some(Tree { value: Value::Whole(SCHEMA), .. }) => {}
        Some(Tree { value, span }) => {
            let message = format!("schema `{}` is not one this version reads", value.to_json());
            mistakes.push(Diagnostic::at(span, message).help(help));
        }
    }
}

/// Refuses a name that does not fit into references, node names and file names.
pub(crate) fn check_name(name: &str, span: &Span, what: &str, mistakes: &mut Vec<Diagnostic>) {
    if name.is_empty() || !name.bytes().all(|byte| byte.is_ascii_alphanumeric() || matches!(byte, b'_' | b'-')) {
        let mistake = Diagnostic::at(span.clone(), format!("`{name}` is no name for a {what}"));
        mistakes.push(mistake.help("a name holds letters a to z, digits, `_` and `-`"));
    } else if ["stage", "member of a suite"].contains(&what) && RESERVED.contains(&name) {
        let mistake = Diagnostic::at(span.clone(), format!("a {what} cannot be called `{name}`"));
        mistakes.push(mistake.help(format!("`-S {name}=…` would mean two things; choose another name")));
    }
}
