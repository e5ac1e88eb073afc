//! `-S path=value` and `--sweep axis=values`: arguments that change a file as if it had been written that way.

use super::{
    document,
    path::{PathValue, joined, parts, span_of},
    tree::{Key, Table, Tree, Value},
};
use crate::{
    diag::{Diagnostic, Sources, instead},
    pipeline::messages::holds_no_parameters,
};

/// What the command line changes in a pipeline file.
#[derive(Debug, Clone, Default)]
pub struct Overrides {
    /// The arguments of `-S`: `represent.epochs=3`, `seed=7`, `task.noise=0.1`, `rounds=19`. Of two for the same path
    /// the last one counts.
    pub set: Vec<String>,
    /// The arguments of `--sweep`: `seed=0..5`, `represent.lambda.consistency=7,11`.
    pub sweep: Vec<String>,
}

/// One argument.
#[derive(Debug, Clone)]
pub(crate) struct Argument {
    pub(crate) is_sweep: bool,
    /// `represent.epochs=3`.
    pub(crate) assignment: String,
    /// Where the assignment begins.
    pub(crate) base: usize,
}

impl Argument {
    /// All arguments, all of `-S` first. Their texts are added to the sources.
    pub(crate) fn all(overrides: &Overrides, sources: &mut Sources) -> Vec<Self> {
        let set = overrides.set.iter().map(|text| ("-S", text));
        let all = set.chain(overrides.sweep.iter().map(|text| ("--sweep", text)));
        all.map(|(flag, text)| Self {
            is_sweep: flag != "-S",
            assignment: text.clone(),
            base: sources.add("<command line>", format!("{flag} {text}")) + flag.len() + 1,
        })
        .collect()
    }

    /// The path before `=`.
    pub(crate) fn path(&self) -> &str {
        self.assignment.split('=').next().unwrap_or_default().trim()
    }

    /// Whether path or value is missing, which [`apply`] reports.
    pub(crate) fn is_malformed(&self) -> bool {
        self.path().is_empty() || !self.assignment.contains('=')
    }
}

/// What arguments and suites change beside values: the matrix.
#[derive(Debug, Default)]
pub(crate) struct Changes {
    /// The axes that they add.
    pub(crate) sweeps: Vec<PathValue>,
    /// The paths that they set. None of them may be an axis as well.
    pub(crate) set: Vec<Key>,
}

/// Applies the arguments to a document.
pub(crate) fn apply(
    document: &mut Table,
    arguments: &[Argument],
    changes: &mut Changes,
    mistakes: &mut Vec<Diagnostic>,
) {
    for argument in arguments {
        if let Some(mistake) = document::too_many_parts(&argument.assignment, argument.base) {
            mistakes.push(mistake);
            continue;
        }
        let applied = apply_one(document, argument, changes, mistakes);
        mistakes.extend(applied.err());
    }
}

fn apply_one(
    document: &mut Table,
    argument: &Argument,
    changes: &mut Changes,
    mistakes: &mut Vec<Diagnostic>,
) -> Result<(), Diagnostic> {
    let (path, value) = split(argument)?;
    if argument.is_sweep {
        let axis = Key::new(path.text, path.base..path.base + path.text.len());
        changes.sweeps.push(PathValue { keys: vec![axis], value: listed(value, mistakes) });
        return Ok(());
    }
    match scalar(value, mistakes) {
        Some(value) => set_path(document, parts(path.text, path.base), value, changes),
        None => Ok(()),
    }
}

/// Sets the value at a path that is written as `-S` writes it.
pub(crate) fn set_path(
    document: &mut Table,
    path: Vec<Key>,
    value: Tree,
    changes: &mut Changes,
) -> Result<(), Diagnostic> {
    changes.set.push(Key::new(joined(&path), span_of(&path)));
    document.set(&place_in_file(document, path)?, value).map_err(|key| holds_no_parameters(&key))
}

/// A piece of an argument and where it begins.
#[derive(Debug, Clone, Copy)]
struct Piece<'a> {
    text: &'a str,
    base: usize,
}

impl<'a> Piece<'a> {
    fn trimmed(text: &'a str, base: usize) -> Self {
        Self { text: text.trim(), base: base + (text.len() - text.trim_start().len()) }
    }
}

/// Path and value.
fn split(argument: &Argument) -> Result<(Piece<'_>, Piece<'_>), Diagnostic> {
    let (text, base) = (argument.assignment.as_str(), argument.base);
    let usage = if argument.is_sweep { "--sweep stage.param=1,2,3" } else { "-S stage.param=value" };
    let refuse =
        |message: String| Err(Diagnostic::at(base..base + text.len(), message).help(format!("write `{usage}`")));
    let Some((path, value)) = text.split_once('=') else {
        return refuse("no `=` between parameter and value".to_owned());
    };
    if path.trim().is_empty() || value.trim().is_empty() {
        let what = if path.trim().is_empty() { "a parameter before" } else { "a value after" };
        return refuse(format!("{what} `=` is missing"));
    }
    Ok((Piece::trimmed(path, base), Piece::trimmed(value, base + path.len() + 1)))
}

/// The path in the file that a path of `-S` means.
fn place_in_file(document: &Table, mut path: Vec<Key>) -> Result<Vec<Key>, Diagnostic> {
    if let Some(empty) = path.iter().find(|part| part.text.is_empty()) {
        return Err(Diagnostic::at(empty.span.clone(), "a part of the path is empty").help("write `stage.param`"));
    }
    let head = path[0].clone();
    let parent = match (head.text.as_str(), path.len()) {
        ("seed" | "preset" | "name" | "description", 1) | ("task" | "loop", 2..) => return Ok(path),
        ("rounds", 1) => "loop",
        (_, length) => {
            check_stage(document, &head, length)?;
            "stages"
        }
    };
    path.insert(0, Key::new(parent, head.span));
    Ok(path)
}

/// Refuses a path that names no parameter of a stage.
fn check_stage(document: &Table, head: &Key, length: usize) -> Result<(), Diagnostic> {
    let name = &head.text;
    let refuse = |message: String| Diagnostic::at(head.span.clone(), message);
    let Some(stages) = document.get("stages").and_then(|stages| stages.value.as_table()) else {
        return Err(refuse(format!("there is no stage `{name}`")));
    };
    if !stages.contains(name) {
        let names = stages.keys().map(|key| key.text.as_str());
        let help = instead(name, "stages", names.chain(["seed", "preset", "task", "rounds"]));
        return Err(refuse(format!("there is no stage `{name}`")).help(help));
    }
    if length < 2 {
        let mistake = refuse(format!("`{name}` is a stage, not a parameter"));
        return Err(mistake.help(format!("write `-S {name}.param=value`")));
    }
    Ok(())
}

/// A TOML value, or else the text itself: `epochs=3` is a number and `objective=pcc` is a text.
fn scalar(piece: Piece<'_>, mistakes: &mut Vec<Diagnostic>) -> Option<Tree> {
    let Piece { text, base } = piece;
    let as_text = || Some(Tree { value: Value::Text(text.to_owned()), span: base..base + text.len() });
    document::value(text, base, mistakes).unwrap_or_else(as_text)
}

/// The values of a sweep: `0..5`, `1,2,3`, or a TOML list.
fn listed(piece: Piece<'_>, mistakes: &mut Vec<Diagnostic>) -> Tree {
    let Piece { text, base } = piece;
    let span = base..base + text.len();
    if text.starts_with('[') || text.contains("..") {
        let nothing = Tree { value: Value::List(Vec::new()), span };
        return scalar(piece, mistakes).unwrap_or(nothing);
    }
    let mut at = base;
    let mut items = Vec::new();
    for item in text.split(',') {
        items.extend(scalar(Piece::trimmed(item, at), mistakes));
        at += item.len() + 1;
    }
    Tree { value: Value::List(items), span }
}
