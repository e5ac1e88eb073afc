//! One `[stages.name]`: `kind`, `inputs`, `loop`, `first` and `stream` taken out, the rest left to the kind.

use toml::de::{DeTable, DeValue};

use super::{
    draft::{InputDraft, Reference, StageDraft},
    parse::{table_of, typed},
    reference::spell,
    tree::{Key, Tree},
    wording::{instead, what},
};
use crate::{
    diag::{Diagnostic, Span},
    stage::{Kind, Port},
};

/// What all stages are read against.
struct Surroundings<'a> {
    names: &'a [String],
    has_loop: bool,
    kinds: &'static [Kind],
}

/// Reads all stages.
pub(super) fn read<'i>(
    tables: Vec<(Key<'i>, Span, DeTable<'i>)>,
    rounds: Option<u32>,
    kinds: &'static [Kind],
    mistakes: &mut Vec<Diagnostic>,
) -> Vec<StageDraft<'i>> {
    let names: Vec<String> = tables.iter().map(|(key, ..)| key.get_ref().to_string()).collect();
    let around = Surroundings { names: &names, has_loop: rounds.is_some(), kinds };
    let stages: Vec<_> = tables.into_iter().map(|(key, _, table)| stage(&key, table, &around, mistakes)).collect();
    if let (None, Some(stage)) = (rounds, stages.iter().find(|stage| stage.from.is_some())) {
        let message = format!("stage `{}` is in the loop, but the pipeline has none", stage.name);
        let mistake = Diagnostic::at(stage.span.clone(), message);
        mistakes.push(mistake.help("write `[loop]` with `rounds = …`, or leave `loop` out of the stages"));
    }
    stages
}

fn stage<'i>(
    key: &Key<'i>,
    mut table: DeTable<'i>,
    around: &Surroundings<'_>,
    mistakes: &mut Vec<Diagnostic>,
) -> StageDraft<'i> {
    let (name, span) = (key.get_ref().to_string(), key.span());
    let kind = kind_of(table.remove("kind"), &name, &span, around.kinds, mistakes);
    let count = mistakes.len();
    let from = from_of(table.remove("loop"), mistakes);
    let loop_broken = mistakes.len() > count || (from.is_some() && !around.has_loop);
    let first = table_of(table.remove("first"), "first", mistakes);
    if let (Some((_, span)), None) = (&first, from) {
        let mistake = Diagnostic::at(span.clone(), format!("`{name}` is not in the loop, so it has no first round"));
        mistakes.push(mistake.help("write `loop = true`, or set the parameters themselves"));
    }
    let stream = stream_of(table.remove("stream"), mistakes);
    let (written, count) = (table.remove("inputs"), mistakes.len());
    let inputs = table_of(written, "inputs", mistakes).map(|(inputs, _)| inputs);
    let mut inputs_broken = mistakes.len() > count;
    let inputs = inputs.map_or_else(Vec::new, |table| {
        let names = table.len();
        let inputs = inputs_of(table, kind, around, mistakes);
        inputs_broken |= inputs.len() < names;
        inputs
    });
    let first = first.map(|(first, _)| first);
    StageDraft { name, span, kind, params: table, first, from, loop_broken, stream, inputs, inputs_broken }
}

fn kind_of(
    value: Option<Tree<'_>>,
    stage: &str,
    header: &Span,
    kinds: &'static [Kind],
    mistakes: &mut Vec<Diagnostic>,
) -> Option<&'static Kind> {
    let names = || kinds.iter().map(|kind| kind.name);
    let Some(value) = value else {
        let mistake = Diagnostic::at(header.clone(), format!("stage `{stage}` has no `kind`"));
        mistakes.push(mistake.help(format!("kinds: {}", names().collect::<Vec<_>>().join(", "))));
        return None;
    };
    let span = value.span();
    let name: String = typed(Some(value), "kind", mistakes)?;
    let kind = kinds.iter().find(|kind| kind.name == name);
    if kind.is_none() {
        mistakes.push(Diagnostic::at(span, format!("unknown kind `{name}`")).help(instead(&name, "kinds", names())));
    }
    kind
}

/// `loop = true` or `loop = { from = 1 }`.
fn from_of(value: Option<Tree<'_>>, mistakes: &mut Vec<Diagnostic>) -> Option<u32> {
    let value = value?;
    let span = value.span();
    match value.into_inner() {
        DeValue::Boolean(in_loop) => in_loop.then_some(0),
        DeValue::Table(mut table) => {
            let from = table.remove("from");
            for key in table.keys() {
                let message = format!("`loop` has no `{}`", key.get_ref());
                mistakes.push(Diagnostic::at(key.span(), message).help("write `loop = { from = 1 }`"));
            }
            Some(typed(from, "from", mistakes).unwrap_or(0))
        }
        other => {
            let message = format!("`loop` takes true or a table, but is {}", what(&other));
            mistakes.push(Diagnostic::at(span, message).help("write `loop = true` or `loop = { from = 1 }`"));
            None
        }
    }
}

fn stream_of(value: Option<Tree<'_>>, mistakes: &mut Vec<Diagnostic>) -> Option<String> {
    let span = value.as_ref()?.span();
    let stream: String = typed(value, "stream", mistakes)?;
    if stream.is_empty() {
        let mistake = Diagnostic::at(span, "the stream has no name");
        mistakes.push(mistake.help("write a word such as `stream = \"second\"`, or leave it out"));
    }
    Some(stream)
}

fn inputs_of(
    table: DeTable<'_>,
    kind: Option<&'static Kind>,
    around: &Surroundings<'_>,
    mistakes: &mut Vec<Diagnostic>,
) -> Vec<InputDraft> {
    let mut inputs = Vec::new();
    for (key, value) in table {
        let mut references = Vec::new();
        let count = mistakes.len();
        read_references(value, key.get_ref(), around, &mut references, mistakes);
        let broken = mistakes.len() > count;
        if let Some(port) = kind.and_then(|kind| port_of(kind, &key, mistakes)) {
            inputs.push(InputDraft { port, span: key.span(), references, broken });
        }
    }
    inputs
}

fn port_of(kind: &'static Kind, key: &Key<'_>, mistakes: &mut Vec<Diagnostic>) -> Option<&'static Port> {
    let name = key.get_ref().as_ref();
    let port = kind.ports.iter().find(|port| port.name == name);
    if port.is_none() {
        let mistake = Diagnostic::at(key.span(), format!("`{}` has no input `{name}`", kind.name));
        mistakes.push(mistake.help(instead(name, "inputs", kind.ports.iter().map(|port| port.name))));
    }
    port
}

fn read_references(
    value: Tree<'_>,
    port: &str,
    around: &Surroundings<'_>,
    references: &mut Vec<Reference>,
    mistakes: &mut Vec<Diagnostic>,
) {
    let span = value.span();
    match value.into_inner() {
        DeValue::String(text) => match reference(&text, span, around.names) {
            Ok(reference) => references.push(reference),
            Err(mistake) => mistakes.push(mistake),
        },
        DeValue::Array(items) => {
            for item in items {
                match item.get_ref() {
                    DeValue::String(_) => read_references(item, port, around, references, mistakes),
                    other => mistakes.push(no_reference(port, other, item.span())),
                }
            }
        }
        other => mistakes.push(no_reference(port, &other, span)),
    }
}

fn no_reference(port: &str, value: &DeValue<'_>, span: Span) -> Diagnostic {
    let message = format!("input `{port}` takes the name of a stage, but is {}", what(value));
    Diagnostic::at(span, message).help(format!("write `{port} = \"stage\"` or `{port} = [\"one\", \"two@prev\"]`"))
}

fn reference(text: &str, span: Span, names: &[String]) -> Result<Reference, Diagnostic> {
    let read = spell(text, span.clone())?;
    let Some(stage) = names.iter().position(|name| name == read.name) else {
        let mistake = Diagnostic::at(span, format!("there is no stage `{}`", read.name));
        return Err(mistake.help(instead(read.name, "stages", names.iter().map(String::as_str))));
    };
    Ok(Reference { stage, which: read.which, gathers: read.gathers, span, text: text.to_owned() })
}

#[cfg(test)]
mod tests {
    #[test]
    fn no_kind_has_a_parameter_that_the_pipeline_takes_out() {
        for kind in crate::stage::registry() {
            let schema = serde_json::to_value((kind.schema)()).unwrap();
            for word in ["kind", "inputs", "loop", "first", "stream"] {
                assert!(schema["properties"].get(word).is_none(), "{} has a parameter `{word}`", kind.name);
            }
        }
    }
}
