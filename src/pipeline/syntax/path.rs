//! Dotted paths such as `represent.lambda.consistency`, part by part with their places.

use super::tree::{Key, Table, Tree, Value};
use crate::diag::{Sources, Span};

/// A value at a path, as a table such as `[matrix]` or `set = { … }` writes it.
#[derive(Debug, Clone)]
pub(crate) struct PathValue {
    /// The keys as written. A quoted key may hold several parts.
    pub(crate) keys: Vec<Key>,
    pub(crate) value: Tree,
}

impl PathValue {
    /// The path with dots.
    pub(crate) fn name(&self) -> String {
        joined(&self.keys)
    }

    /// The parts of the path, each with its place.
    pub(crate) fn path(&self, sources: &Sources) -> Vec<Key> {
        self.keys.iter().flat_map(|key| parts_of_key(key, sources)).collect()
    }
}

/// Parts with dots between them.
pub(crate) fn joined(keys: &[Key]) -> String {
    keys.iter().map(|key| key.text.as_str()).collect::<Vec<_>>().join(".")
}

/// The place from the first part of a path to its last.
pub(crate) fn span_of(path: &[Key]) -> Span {
    path.first().map_or(0, |key| key.span.start)..path.last().map_or(0, |key| key.span.end)
}

/// The values of a table by their paths: `a.b = 1` and `[a]` with `b = 1` mean what `"a.b" = 1` means.
pub(crate) fn flatten(table: Table) -> Vec<PathValue> {
    let mut values = Vec::new();
    flatten_below(&[], table, &mut values);
    values
}

fn flatten_below(above: &[Key], table: Table, values: &mut Vec<PathValue>) {
    for entry in table {
        let mut keys = above.to_vec();
        keys.push(entry.key);
        match entry.value {
            Tree { value: Value::Table(below), .. } => flatten_below(&keys, below, values),
            value => values.push(PathValue { keys, value }),
        }
    }
}

/// The parts of a dotted text that stands at `base`.
pub(crate) fn parts(text: &str, base: usize) -> Vec<Key> {
    let mut at = base;
    let mut parts = Vec::new();
    for part in text.split('.') {
        parts.push(Key::new(part, at..at + part.len()));
        at += part.len() + 1;
    }
    parts
}

fn parts_of_key(key: &Key, sources: &Sources) -> Vec<Key> {
    let shown = sources.slice(&key.span).unwrap_or_default();
    let quote = usize::from(shown.starts_with(['"', '\'']));
    if shown.len() == key.text.len() + 2 * quote {
        return parts(&key.text, key.span.start + quote);
    }
    // Escapes stand in the key: its parts have no places of their own.
    key.text.split('.').map(|part| Key::new(part, key.span.clone())).collect()
}
