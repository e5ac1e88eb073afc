//! The matrix: axes as written in `[matrix]` and by `--sweep`, what they vary, and their values.

use std::{collections::BTreeSet, fmt::Write as _};

use serde_json::Value;
use toml::{
    Spanned,
    de::{DeTable, DeValue},
};

use super::{
    draft::{Axis, AxisValue, StageDraft, Target},
    overrides::{Applied, Sweep, parts},
    parse::{table_of, typed},
    tree::{Key, Tree, placed, refuse_infinite, to_json},
    wording::{instead, what},
};
use crate::{
    diag::{Diagnostic, Sources, Span},
    stage::Preset,
};

/// More values than any matrix can use.
pub(super) const MAX_NODES: usize = 100_000;
const VALUES_HELP: &str = "write `[1, 2, 3]`, or `\"0..25\"` for the whole numbers below 25";

/// An axis before it is known what it varies.
#[derive(Debug)]
pub(super) struct WrittenAxis<'i> {
    keys: Vec<Key<'i>>,
    value: Tree<'i>,
    swept: bool,
}

impl WrittenAxis<'_> {
    fn name(&self) -> String {
        self.keys.iter().map(|key| key.get_ref().as_ref()).collect::<Vec<_>>().join(".")
    }

    fn span(&self) -> Span {
        self.keys.last().map_or(0..0, Spanned::span)
    }
}

/// Takes `[matrix]` out of the document. A sweep replaces the axis of the same name.
pub(super) fn written<'i>(
    document: &mut DeTable<'i>,
    Applied { sweeps, set }: Applied<'i>,
    mistakes: &mut Vec<Diagnostic>,
) -> Vec<WrittenAxis<'i>> {
    let mut entries = Vec::new();
    if let Some((table, _)) = table_of(document.remove("matrix"), "matrix", mistakes) {
        flatten(&[], table, &mut entries);
    }
    let mut axes: Vec<WrittenAxis<'i>> =
        entries.into_iter().map(|(keys, value)| WrittenAxis { keys, value, swept: false }).collect();
    for Sweep { axis, values } in sweeps {
        let new = WrittenAxis { keys: vec![axis], value: values, swept: true };
        match axes.iter().position(|old| !old.swept && old.name() == new.name()) {
            Some(same) => axes[same] = new,
            None => axes.push(new),
        }
    }
    for path in set.iter().filter(|path| axes.iter().any(|axis| axis.name() == path.get_ref().as_ref())) {
        let mistake = Diagnostic::at(path.span(), format!("`{}` is an axis of the matrix", path.get_ref()));
        mistakes.push(mistake.help(format!("write `--sweep {}=…` to replace the axis", path.get_ref())));
    }
    for axis in &mut axes {
        refuse_infinite(&mut axis.value, mistakes);
    }
    axes
}

/// `a.b = [1]` and `[matrix.a]` mean what `"a.b" = [1]` means.
pub(super) fn flatten<'i>(above: &[Key<'i>], table: DeTable<'i>, entries: &mut Vec<(Vec<Key<'i>>, Tree<'i>)>) {
    for (key, value) in table {
        let mut keys = above.to_vec();
        keys.push(key);
        let span = value.span();
        match value.into_inner() {
            DeValue::Table(below) => flatten(&keys, below, entries),
            value => entries.push((keys, Spanned::new(span, value))),
        }
    }
}

/// For each axis written as a range, its values as TOML text.
pub(super) fn ranges(axes: &[WrittenAxis<'_>], mistakes: &mut Vec<Diagnostic>) -> Vec<Option<String>> {
    let mut texts = Vec::new();
    for axis in axes {
        let read = match axis.value.get_ref() {
            DeValue::String(text) => range_text(text, axis.value.span()).map(Some),
            _ => Ok(None),
        };
        texts.push(read.unwrap_or_else(|mistake| {
            mistakes.push(mistake);
            Some("[]".to_owned())
        }));
    }
    texts
}

fn range_text(text: &str, span: Span) -> Result<String, Diagnostic> {
    let refuse = |message: String| Err(Diagnostic::at(span.clone(), message).help(VALUES_HELP));
    let Some((low, high)) = text.split_once("..") else {
        return refuse(format!("`{text}` is no range"));
    };
    let (Ok(low), Ok(high)) = (low.trim().parse::<i64>(), high.trim().parse::<i64>()) else {
        return refuse(format!("`{text}` is no range of whole numbers"));
    };
    if low >= high {
        return refuse(format!("the range `{text}` holds no number"));
    }
    if high.abs_diff(low) > MAX_NODES as u64 {
        return refuse(format!("the range `{text}` holds more than {MAX_NODES} numbers"));
    }
    let mut list = String::from("[");
    for value in low..high {
        _ = write!(list, "{value},");
    }
    list.push(']');
    Ok(list)
}

/// Reads the axes, against the stages that they vary.
pub(super) fn read<'i>(
    written: Vec<WrittenAxis<'i>>,
    ranges: &'i [Option<String>],
    sources: &Sources,
    stages: &[StageDraft<'_>],
    mistakes: &mut Vec<Diagnostic>,
) -> Vec<Axis<'i>> {
    let mut axes: Vec<Axis<'i>> = Vec::new();
    for (written, range) in written.into_iter().zip(ranges) {
        let (name, span) = (written.name(), written.span());
        if axes.iter().any(|axis| axis.name == name) {
            let mistake = Diagnostic::at(span, format!("the axis `{name}` is given twice"));
            mistakes.push(mistake.help("join the values of both in one list"));
            continue;
        }
        let path = path_of(&written.keys, sources);
        let target = match target_of(&path, stages) {
            Ok(target) => target,
            Err(mistake) => {
                mistakes.push(mistake);
                continue;
            }
        };
        let values = values_of(written.value, range.as_deref(), &target, mistakes);
        if !values.is_empty() {
            axes.push(Axis { name, span, target, values });
        }
    }
    axes
}

/// The parts of the path an axis names, each with its place: quoted keys hold several.
pub(super) fn path_of<'i>(keys: &[Key<'i>], sources: &Sources) -> Vec<Key<'i>> {
    let mut path = Vec::new();
    for key in keys {
        let (span, text) = (key.span(), key.get_ref());
        let shown = sources.slice(&span).unwrap_or_default();
        let quote = usize::from(shown.starts_with(['"', '\'']));
        if shown.len() == text.len() + 2 * quote {
            path.extend(parts(text, span.start + quote));
        } else {
            let whole = parts(text, 0).into_iter().map(|part| Spanned::new(span.clone(), part.into_inner()));
            path.extend(whole);
        }
    }
    path
}

fn target_of<'i>(path: &[Key<'i>], stages: &[StageDraft<'_>]) -> Result<Target<'i>, Diagnostic> {
    let words: Vec<&str> = path.iter().map(|part| part.get_ref().as_ref()).collect();
    let span = path[0].span().start..path[path.len() - 1].span().end;
    let refuse = |message: String, help: String| Err(Diagnostic::at(span.clone(), message).help(help));
    match words.as_slice() {
        ["seed"] => return Ok(Target::Seed),
        ["preset"] => return Ok(Target::Preset),
        ["task", _, ..] => return Ok(Target::Task(path[1..].to_vec())),
        ["task"] => {
            let help = "write `\"task.noise\" = …`".to_owned();
            return refuse("`task` is a table, not an option of the task".to_owned(), help);
        }
        _ => {}
    }
    let Some(stage) = stages.iter().position(|stage| stage.name == words[0]) else {
        let names = stages.iter().map(|stage| stage.name.as_str()).chain(["seed", "preset", "task"]);
        return refuse(
            format!("the axis `{}` names no parameter: there is no stage `{}`", words.join("."), words[0]),
            instead(words[0], "an axis begins with one of", names),
        );
    };
    match words.as_slice() {
        [name] => refuse(format!("`{name}` is a stage, not a parameter"), format!("write `\"{name}.param\" = …`")),
        [name, word @ ("kind" | "inputs" | "loop" | "stream"), ..] => refuse(
            format!("an axis cannot vary `{word}` of `{name}`"),
            "an axis varies a parameter, the seed, the preset or an option of the task".to_owned(),
        ),
        [name, "first", ..] if stages[stage].from.is_none() => {
            refuse(format!("`{name}` is not in the loop, so it has no first round"), "leave `first` out".to_owned())
        }
        [_, "first", _, ..] => Ok(Target::Stage { stage, in_first: true, path: path[2..].to_vec() }),
        _ => Ok(Target::Stage { stage, in_first: false, path: path[1..].to_vec() }),
    }
}

fn values_of<'i>(
    written: Tree<'i>,
    range: Option<&'i str>,
    target: &Target<'_>,
    mistakes: &mut Vec<Diagnostic>,
) -> Vec<AxisValue<'i>> {
    let span = written.span();
    let listed = range.and_then(|text| DeValue::parse(text).ok()).map(|list| placed(list, span.clone()));
    let items = match listed.unwrap_or(written).into_inner() {
        DeValue::Array(items) => items,
        other => {
            let message = format!("an axis takes a list or a range, but is {}", what(&other));
            mistakes.push(Diagnostic::at(span, message).help(VALUES_HELP));
            return Vec::new();
        }
    };
    if items.is_empty() && range.is_none() {
        mistakes.push(Diagnostic::at(span, "the axis has no values").help(VALUES_HELP));
    }
    let mut seen = BTreeSet::new();
    items.into_iter().filter_map(|value| checked(value, target, &mut seen, mistakes)).collect()
}

/// A value that can be used and was not there before.
fn checked<'i>(
    value: Tree<'i>,
    target: &Target<'_>,
    seen: &mut BTreeSet<String>,
    mistakes: &mut Vec<Diagnostic>,
) -> Option<AxisValue<'i>> {
    let text = text_of(&value).map_err(|mistake| mistakes.push(mistake)).ok()?;
    if !seen.insert(text.strip_suffix(".0").unwrap_or(&text).to_owned()) {
        let mistake = Diagnostic::at(value.span(), format!("the axis has the value `{text}` twice"));
        mistakes.push(mistake.help("leave one out"));
        return None;
    }
    match target {
        Target::Seed => _ = typed::<u64>(Some(value.clone()), "seed", mistakes)?,
        Target::Preset => _ = typed::<Preset>(Some(value.clone()), "preset", mistakes)?,
        _ => {}
    }
    Some(AxisValue { text, value })
}

/// A value as node names show it: names are also file names and arguments.
fn text_of(value: &Tree<'_>) -> Result<String, Diagnostic> {
    let refuse = |message: String, help: &str| Err(Diagnostic::at(value.span(), message).help(help));
    match (value.get_ref(), to_json(value.get_ref())) {
        (DeValue::String(text), _) => {
            let plain = |byte: u8| byte.is_ascii_alphanumeric() || b"_.+-".contains(&byte);
            if text.is_empty() || !text.bytes().all(plain) {
                return refuse(format!("`{text}` cannot be a value of an axis"), "values become part of node names");
            }
            Ok(text.to_string())
        }
        (_, Value::Number(number)) => Ok(number.to_string()),
        (_, Value::Bool(boolean)) => Ok(boolean.to_string()),
        (other, _) => {
            let message = format!("a value of an axis cannot be {}", what(other));
            refuse(message, "an axis lists numbers, texts, or true and false")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(text: &str) -> Key<'_> {
        Spanned::new(0..0, std::borrow::Cow::Borrowed(text))
    }

    #[test]
    fn a_range_is_half_open() {
        assert_eq!(range_text("2..5", 0..0).as_deref(), Ok("[2,3,4,]"));
        for wrong in ["5..5", "5..2", "a..3", "..", "0..=3", "0..99999999999", "7"] {
            assert!(range_text(wrong, 0..0).is_err(), "{wrong}");
        }
    }

    #[test]
    fn an_axis_varies_seed_preset_task_or_a_stage() {
        assert_eq!(target_of(&[key("seed")], &[]), Ok(Target::Seed));
        assert_eq!(target_of(&[key("task"), key("noise")], &[]), Ok(Target::Task(vec![key("noise")])));
        assert!(target_of(&[key("task")], &[]).is_err());
        assert!(target_of(&[key("nobody"), key("epochs")], &[]).is_err());
    }
}
