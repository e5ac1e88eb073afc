//! The file of a suite, as written.

use crate::{
    diag::{Diagnostic, Span, instead},
    pipeline::syntax::{
        path::{PathValue, flatten},
        tree::{Entry, Key, Table, Tree},
        values,
    },
};

/// The keys of the top level.
const KEYS: [&str; 6] = ["schema", "name", "description", "seeds", "set", "suite"];
/// The keys of a `[suite.name]`.
const MEMBER_KEYS: [&str; 4] = ["pipeline", "seeds", "set", "labels"];

/// A suite.
#[derive(Debug)]
pub(super) struct ParsedSuite {
    pub(super) name: String,
    pub(super) description: String,
    /// Values for all members that have the stage.
    pub(super) set: Vec<PathValue>,
    pub(super) members: Vec<ParsedMember>,
}

/// One `[suite.name]`.
#[derive(Debug)]
pub(super) struct ParsedMember {
    pub(super) name: String,
    /// The path of its file.
    pub(super) pipeline: Option<Key>,
    /// The axis `seed`: its own, or the suite's.
    pub(super) seeds: Option<PathValue>,
    pub(super) set: Vec<PathValue>,
    pub(super) labels: Table,
}

/// Reads a suite. `start` is the place of what the file lacks.
pub(super) fn suite(mut table: Table, start: &Span, mistakes: &mut Vec<Diagnostic>) -> ParsedSuite {
    for key in table.keys().filter(|key| !KEYS.contains(&key.text.as_str())) {
        mistakes.push(unknown_key(key));
    }
    values::check_schema(table.take("schema"), start, mistakes);
    let name = values::name(table.take("name"), "suite", start, mistakes).unwrap_or_default();
    let description = values::text(table.take("description"), "description", mistakes);
    let seeds = table.take_entry("seeds").map(seed_axis);
    let set = set(table.take("set"), mistakes);
    let entries = values::table(table.take("suite"), "suite", mistakes).map(|(table, _)| table).unwrap_or_default();
    if entries.is_empty() {
        let mistake = Diagnostic::at(start.clone(), "the suite has no pipelines");
        mistakes.push(mistake.help("write `[suite.name]` with `pipeline = \"file.toml\"`"));
    }
    let mut members = Vec::new();
    for Entry { key, value } in entries {
        values::check_name(&key.text, &key.span, "member of a suite", mistakes);
        if let Some((table, _)) = values::table(Some(value), &key.text, mistakes) {
            members.push(member(key, table, seeds.as_ref(), mistakes));
        }
    }
    ParsedSuite { name, description: description.map(|(text, _)| text).unwrap_or_default(), set, members }
}

fn unknown_key(key: &Key) -> Diagnostic {
    let mistake = Diagnostic::at(key.span.clone(), format!("a suite has no `{}`", key.text));
    match key.text.as_str() {
        "stages" | "loop" | "task" | "matrix" | "preset" => mistake.help("write it in the file of a pipeline"),
        "extends" => mistake.help("a pipeline can extend another one: write it in the file of the pipeline"),
        "seed" => mistake.help("write `seeds = \"0..5\"`"),
        name => mistake.help(instead(name, "a suite has", KEYS)),
    }
}

fn member(name: Key, mut table: Table, seeds: Option<&PathValue>, mistakes: &mut Vec<Diagnostic>) -> ParsedMember {
    for key in table.keys().filter(|key| !MEMBER_KEYS.contains(&key.text.as_str())) {
        let mistake = Diagnostic::at(key.span.clone(), format!("a member of a suite has no `{}`", key.text));
        mistakes.push(mistake.help(instead(&key.text, "a member has", MEMBER_KEYS)));
    }
    let pipeline = table.take("pipeline");
    if pipeline.is_none() {
        let mistake = Diagnostic::at(name.span.clone(), format!("`{}` names no pipeline", name.text));
        mistakes.push(mistake.help("write `pipeline = \"file.toml\"`, a path from the folder of the suite"));
    }
    let labels = values::table(table.take("labels"), "labels", mistakes);
    ParsedMember {
        name: name.text,
        pipeline: values::text(pipeline, "pipeline", mistakes).map(|(path, span)| Key::new(path, span)),
        seeds: table.take_entry("seeds").map(seed_axis).or_else(|| seeds.cloned()),
        set: set(table.take("set"), mistakes),
        labels: labels.map(|(table, _)| table).unwrap_or_default(),
    }
}

/// `seeds` as the axis `seed`.
fn seed_axis(entry: Entry) -> PathValue {
    PathValue { keys: vec![Key::new("seed", entry.key.span)], value: entry.value }
}

fn set(value: Option<Tree>, mistakes: &mut Vec<Diagnostic>) -> Vec<PathValue> {
    values::table(value, "set", mistakes).map(|(table, _)| flatten(table)).unwrap_or_default()
}
