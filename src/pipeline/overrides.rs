//! `-S path=value` and `--sweep axis=values`: arguments that change the file as if it had been written that way.

use std::borrow::Cow;

use toml::{
    Spanned,
    de::{DeArray, DeTable, DeValue},
};

use super::{
    tree::{Key, Tree, endless_key, set, shifted},
    wording::instead,
};
use crate::diag::{Diagnostic, Span};

/// What the command line changes in a pipeline file.
#[derive(Debug, Clone, Default)]
pub struct Overrides {
    /// The arguments of `-S`: `represent.epochs=3`, `seed=7`, `task.noise=0.1`, `rounds=19`. The last one counts.
    pub set: Vec<String>,
    /// The arguments of `--sweep`: `seed=0..5`, `represent.lambda.consistency=7,11`.
    pub sweep: Vec<String>,
}

impl Overrides {
    /// The arguments as the user sees them: flag and text, all of `-S` first.
    pub(super) fn shown(&self) -> impl Iterator<Item = String> {
        let set = self.set.iter().map(|text| format!("-S {text}"));
        set.chain(self.sweep.iter().map(|text| format!("--sweep {text}")))
    }
}

/// An axis that an argument adds.
#[derive(Debug)]
pub(super) struct Sweep<'i> {
    pub(super) axis: Key<'i>,
    pub(super) values: Tree<'i>,
}

/// What the arguments leave to the matrix.
#[derive(Debug, Default)]
pub(super) struct Applied<'i> {
    /// The axes they add.
    pub(super) sweeps: Vec<Sweep<'i>>,
    /// The paths that `-S` set, which must not be axes as well.
    pub(super) set: Vec<Key<'i>>,
}

/// An argument, read up to its assignment.
#[derive(Debug, Clone, Copy)]
pub(super) struct Argument<'i> {
    pub(super) is_sweep: bool,
    /// `represent.epochs=3`.
    pub(super) assignment: &'i str,
    /// Where the assignment begins.
    pub(super) base: usize,
}

impl<'i> Argument<'i> {
    /// Reads an argument as [`Overrides::shown`] writes it.
    pub(super) fn read((base, text): (usize, &'i str)) -> Self {
        let (flag, assignment) = text.split_once(' ').unwrap_or((text, ""));
        Self { is_sweep: flag != "-S", assignment, base: base + flag.len() + 1 }
    }

    /// The path before `=`.
    pub(super) fn path(&self) -> &'i str {
        self.assignment.split('=').next().unwrap_or_default().trim()
    }
}

/// Applies the arguments.
pub(super) fn apply<'i>(
    document: &mut DeTable<'i>,
    arguments: &[Argument<'i>],
    applied: &mut Applied<'i>,
    mistakes: &mut Vec<Diagnostic>,
) {
    for Argument { is_sweep, assignment, base } in arguments {
        if let Some(span) = endless_key(assignment) {
            let span = span.start + base..span.end + base;
            mistakes.push(Diagnostic::at(span, "nested too deeply").help("no parameter lies that deep"));
            continue;
        }
        let base = *base;
        let read = match is_sweep {
            false => split(assignment, base, "-S stage.param=value").and_then(|((path, at), value)| {
                set_path(document, parts(&Cow::Borrowed(path), at), scalar(value), applied)
            }),
            true => split(assignment, base, "--sweep stage.param=1,2,3").map(|((axis, base), values)| {
                let axis = Spanned::new(base..base + axis.len(), Cow::Borrowed(axis));
                applied.sweeps.push(Sweep { axis, values: listed(values) });
            }),
        };
        mistakes.extend(read.err());
    }
}

/// Sets the value at a path as `-S` writes it.
pub(super) fn set_path<'i>(
    document: &mut DeTable<'i>,
    path: Vec<Key<'i>>,
    value: Tree<'i>,
    applied: &mut Applied<'i>,
) -> Result<(), Diagnostic> {
    let words: Vec<&str> = path.iter().map(|key| key.get_ref().as_ref()).collect();
    let span = path.first().map_or(0, |key| key.span().start)..path.last().map_or(0, |key| key.span().end);
    applied.set.push(Spanned::new(span, Cow::Owned(words.join("."))));
    set(document, &path_of(document, path)?, value)
        .map_err(|key| Diagnostic::at(key.span(), format!("`{}` holds no parameters", key.get_ref())))
}

/// A text and where it begins.
type Placed<'i> = (&'i str, usize);

fn split<'i>(text: &'i str, base: usize, usage: &str) -> Result<(Placed<'i>, Placed<'i>), Diagnostic> {
    let whole: Span = base..base + text.len();
    let Some((path, value)) = text.split_once('=') else {
        return Err(Diagnostic::at(whole, "no `=` between parameter and value").help(format!("write `{usage}`")));
    };
    if path.trim().is_empty() || value.trim().is_empty() {
        let what = if path.trim().is_empty() { "a parameter before" } else { "a value after" };
        return Err(Diagnostic::at(whole, format!("{what} `=` is missing")).help(format!("write `{usage}`")));
    }
    Ok((trimmed(path, base), trimmed(value, base + path.len() + 1)))
}

fn trimmed(text: &str, base: usize) -> Placed<'_> {
    (text.trim(), base + (text.len() - text.trim_start().len()))
}

/// The parts of a dotted path, each with its place.
pub(super) fn parts<'i>(path: &Cow<'i, str>, base: usize) -> Vec<Key<'i>> {
    let mut at = 0;
    let mut parts = Vec::new();
    for part in path.split('.') {
        let text = match path {
            Cow::Borrowed(path) => Cow::Borrowed(&path[at..at + part.len()]),
            Cow::Owned(_) => Cow::Owned(part.to_owned()),
        };
        parts.push(Spanned::new(base + at..base + at + part.len(), text));
        at += part.len() + 1;
    }
    parts
}

/// Where in the file a path of `-S` leads.
fn path_of<'i>(document: &DeTable<'i>, mut path: Vec<Key<'i>>) -> Result<Vec<Key<'i>>, Diagnostic> {
    if let Some(empty) = path.iter().find(|part| part.get_ref().is_empty()) {
        return Err(Diagnostic::at(empty.span(), "a part of the path is empty").help("write `stage.param`"));
    }
    let head = path[0].clone();
    let insert = |path: &mut Vec<Key<'i>>, word: &'static str| {
        path.insert(0, Spanned::new(head.span(), Cow::Borrowed(word)));
    };
    match (head.get_ref().as_ref(), path.len()) {
        ("seed" | "preset" | "name" | "description", 1) => {}
        ("rounds", 1) => insert(&mut path, "loop"),
        ("task" | "loop", 2..) => {}
        (name, length) => {
            let Some(DeValue::Table(stages)) = document.get("stages").map(Spanned::get_ref) else {
                return Err(Diagnostic::at(head.span(), format!("there is no stage `{name}`")));
            };
            if !stages.contains_key(name) {
                let names = stages.keys().map(|key| key.get_ref().as_ref());
                let help = instead(name, "stages", names.chain(["seed", "preset", "task", "rounds"]));
                return Err(Diagnostic::at(head.span(), format!("there is no stage `{name}`")).help(help));
            }
            if length < 2 {
                return Err(Diagnostic::at(head.span(), format!("`{name}` is a stage, not a parameter"))
                    .help(format!("write `-S {name}.param=value`")));
            }
            insert(&mut path, "stages");
        }
    }
    Ok(path)
}

/// A TOML value, or else the text itself: `epochs=3` is a number and `objective=pcc` a text.
fn scalar((text, base): Placed<'_>) -> Tree<'_> {
    match DeValue::parse(text) {
        Ok(value) => shifted(value, base),
        Err(_) => Spanned::new(base..base + text.len(), DeValue::String(Cow::Borrowed(text))),
    }
}

/// The values of a sweep: `0..5`, `1,2,3`, or a TOML array.
fn listed((text, base): Placed<'_>) -> Tree<'_> {
    if text.starts_with('[') || text.contains("..") {
        return scalar((text, base));
    }
    let mut at = base;
    let mut items = DeArray::new();
    for item in text.split(',') {
        items.push(scalar(trimmed(item, at)));
        at += item.len() + 1;
    }
    Spanned::new(base..base + text.len(), DeValue::Array(items))
}
