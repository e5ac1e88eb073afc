//! TOML values with their places: what the pipeline does with them before they become parameters.

use std::{borrow::Cow, ops::Range};

use serde_json::{Map, Number, Value};
use toml::{
    Spanned,
    de::{DeTable, DeValue},
};

use crate::diag::Diagnostic;

/// A TOML value and its place.
pub(super) type Tree<'i> = Spanned<DeValue<'i>>;
/// A key and its place.
pub(super) type Key<'i> = Spanned<Cow<'i, str>>;

/// More parts than any path needs.
const MAX_PARTS: usize = 32;
/// Deeper than any parameter lies.
const MAX_DEPTH: usize = 48;

/// A dotted key of so many parts that the tree, which is walked recursively, could outgrow the stack.
pub(super) fn endless_key(text: &str) -> Option<Range<usize>> {
    let (mut start, mut parts) = (0, 1);
    let mut previous = ' ';
    for (at, c) in text.char_indices() {
        match c {
            '.' if previous != '.' => parts += 1,
            '.' | '=' | ',' | '[' | ']' | '{' | '}' | '#' | '\n' => (start, parts) = (at + 1, 1),
            _ => {}
        }
        if parts > MAX_PARTS {
            return Some(start..at);
        }
        previous = c;
    }
    None
}

/// The first entry of a table that lies too deep in itself.
pub(super) fn endless_entry(table: &DeTable<'_>) -> Option<Range<usize>> {
    table.iter().find(|(_, value)| depth(value.get_ref()) > MAX_DEPTH).map(|(key, _)| key.span())
}

fn depth(value: &DeValue<'_>) -> usize {
    match value {
        DeValue::Array(items) => 1 + items.iter().map(|item| depth(item.get_ref())).max().unwrap_or(0),
        DeValue::Table(table) => 1 + table.values().map(|value| depth(value.get_ref())).max().unwrap_or(0),
        _ => 0,
    }
}

/// A tree whose places are counted from `base` on.
pub(super) fn shifted(tree: Tree<'_>, base: usize) -> Tree<'_> {
    moved(tree, &|span| span.start + base..span.end + base)
}

/// A tree that stands at one place as a whole.
pub(super) fn placed(tree: Tree<'_>, at: Range<usize>) -> Tree<'_> {
    moved(tree, &|_| at.clone())
}

fn moved<'i>(tree: Tree<'i>, place: &dyn Fn(Range<usize>) -> Range<usize>) -> Tree<'i> {
    let span = place(tree.span());
    let value = match tree.into_inner() {
        DeValue::Array(items) => DeValue::Array(items.into_iter().map(|item| moved(item, place)).collect()),
        DeValue::Table(table) => {
            let entries = table.into_iter().map(|(key, value)| {
                let span = place(key.span());
                (Spanned::new(span, key.into_inner()), moved(value, place))
            });
            DeValue::Table(entries.collect())
        }
        scalar => scalar,
    };
    Spanned::new(span, value)
}

/// Lays `over` upon `under`: tables are merged, everything else is replaced.
pub(super) fn lay_over<'i>(under: &mut DeTable<'i>, over: &DeTable<'i>) {
    for (key, value) in over {
        match (under.get_mut(key).map(Spanned::get_mut), value.get_ref()) {
            (Some(DeValue::Table(under)), DeValue::Table(over)) => lay_over(under, over),
            _ => replace(under, key.clone(), value.clone()),
        }
    }
}

/// Inserts or replaces an entry; its key takes the new place, where the mistake would be.
fn replace<'i>(table: &mut DeTable<'i>, key: Key<'i>, value: Tree<'i>) {
    table.remove(key.get_ref().as_ref());
    table.insert(key, value);
}

/// Sets the value at a path, and makes the tables on the way.
///
/// # Errors
/// The part of the path that is something else than a table.
pub(super) fn set<'i>(table: &mut DeTable<'i>, path: &[Key<'i>], value: Tree<'i>) -> Result<(), Key<'i>> {
    let [key, rest @ ..] = path else { return Ok(()) };
    if rest.is_empty() {
        replace(table, key.clone(), value);
        return Ok(());
    }
    let below = table.entry(key.clone()).or_insert_with(|| Spanned::new(key.span(), DeValue::Table(DeTable::new())));
    match below.get_mut() {
        DeValue::Table(below) => set(below, rest, value),
        _ => Err(key.clone()),
    }
}

/// The value at a path, or the one on the way that is not a table.
pub(super) fn find<'a, 'i>(table: &'a DeTable<'i>, path: &[impl AsRef<str>]) -> Option<&'a Tree<'i>> {
    let [key, rest @ ..] = path else { return None };
    let found = table.get(key.as_ref())?;
    match found.get_ref() {
        DeValue::Table(below) if !rest.is_empty() => find(below, rest),
        _ => Some(found),
    }
}

/// Takes the innermost entry away in which a mistake lies, and says its key; `None` where no entry holds it.
pub(super) fn take_entry_at(table: &mut DeTable<'_>, mistake: &Range<usize>) -> Option<String> {
    let within = |span: Range<usize>| span.start <= mistake.start && mistake.end <= span.end;
    let key = table
        .iter()
        .find(|(key, value)| within(key.span()) || within(value.span()) || holds(value, mistake))
        .map(|(key, _)| key.get_ref().to_string())?;
    if let Some(DeValue::Table(below)) = table.get_mut(key.as_str()).map(Spanned::get_mut)
        && let Some(inner) = take_entry_at(below, mistake)
    {
        return Some(format!("{key}.{inner}"));
    }
    table.remove(key.as_str());
    Some(key)
}

/// Whether a mistake lies in a table that is spread over the text, such as `[stages.a.b]` or dotted keys.
fn holds(value: &Tree<'_>, mistake: &Range<usize>) -> bool {
    let DeValue::Table(table) = value.get_ref() else { return false };
    table.iter().any(|(key, value)| {
        let within = |span: Range<usize>| span.start <= mistake.start && mistake.end <= span.end;
        within(key.span()) || within(value.span()) || holds(value, mistake)
    })
}

/// Takes every number away that is not finite, and reports it.
pub(super) fn refuse_infinite(value: &mut Tree<'_>, mistakes: &mut Vec<Diagnostic>) -> bool {
    let span = value.span();
    match value.get_mut() {
        DeValue::Float(float) => {
            let finite = float.as_str().parse::<f64>().is_ok_and(f64::is_finite);
            if !finite {
                let what =
                    if float.as_str().contains(['n', 'i']) { "not a number to compute with" } else { "too large" };
                let message = format!("`{}` is {what}", float.as_str());
                mistakes.push(Diagnostic::at(span, message).help("write a finite number"));
            }
            finite
        }
        DeValue::Array(items) => {
            let kept = std::mem::replace(items, toml::de::DeArray::new())
                .into_iter()
                .filter_map(|mut item| refuse_infinite(&mut item, mistakes).then_some(item));
            *items = kept.collect();
            true
        }
        DeValue::Table(table) => {
            refuse_infinite_in(table, mistakes);
            true
        }
        _ => true,
    }
}

/// Takes every number of a table away that is not finite, and reports it.
pub(super) fn refuse_infinite_in(table: &mut DeTable<'_>, mistakes: &mut Vec<Diagnostic>) {
    let kept = std::mem::take(table)
        .into_iter()
        .filter_map(|(key, mut value)| refuse_infinite(&mut value, mistakes).then_some((key, value)));
    *table = kept.collect();
}

/// The value without its places.
pub(super) fn to_json(value: &DeValue<'_>) -> Value {
    match value {
        DeValue::String(text) => Value::String(text.to_string()),
        DeValue::Integer(integer) => {
            let (text, radix) = (integer.as_str(), integer.radix());
            let signed = i64::from_str_radix(text, radix).map(Number::from);
            let number = signed.or_else(|_| u64::from_str_radix(text, radix).map(Number::from));
            // Larger ones fit no parameter: as text they are refused by type.
            number.map_or_else(|_| Value::String(text.to_owned()), Value::Number)
        }
        DeValue::Float(float) => {
            let number = float.as_str().parse().ok().and_then(Number::from_f64);
            number.map_or(Value::Null, Value::Number)
        }
        DeValue::Boolean(boolean) => Value::Bool(*boolean),
        DeValue::Datetime(datetime) => Value::String(datetime.to_string()),
        DeValue::Array(items) => items.iter().map(|item| to_json(item.get_ref())).collect(),
        DeValue::Table(table) => Value::Object(table_to_json(table)),
    }
}

/// A table without its places.
pub(super) fn table_to_json(table: &DeTable<'_>) -> Map<String, Value> {
    table.iter().map(|(key, value)| (key.get_ref().to_string(), to_json(value.get_ref()))).collect()
}

/// Lays one JSON value over another as [`lay_over`] does.
pub(super) fn lay_json_over(under: &mut Value, over: Value) {
    match (under, over) {
        (Value::Object(under), Value::Object(over)) => {
            for (key, value) in over {
                match under.get_mut(&key) {
                    Some(below) => lay_json_over(below, value),
                    None => _ = under.insert(key, value),
                }
            }
        }
        (under, over) => *under = over,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_nan_and_an_overflow_are_refused_and_the_rest_stays() {
        let text = "{ a = nan, b = [1.0, -inf], c = 1e999, d = 2.0 }";
        let mut tree = DeValue::parse(text).unwrap();
        let mut mistakes = Vec::new();
        refuse_infinite(&mut tree, &mut mistakes);
        let places: Vec<&str> = mistakes.iter().map(|one| &text[one.span.clone().unwrap()]).collect();
        assert_eq!(places, ["nan", "-inf", "1e999"]);
        assert_eq!(to_json(tree.get_ref()), serde_json::json!({ "b": [1.0], "d": 2.0 }));
    }
}
