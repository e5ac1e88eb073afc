//! Looks up kinds, ports, stages and axes.

use std::path::PathBuf;

use serde_json::Value;

use super::{
    axes,
    resolved::{Axis, Input, Pipeline, Reference, Stage, Target},
    streams, wiring,
};
use crate::{
    diag::{Diagnostic, Span, instead},
    pipeline::syntax::{
        parsed::{ParsedInput, ParsedKind, ParsedPipeline, ParsedStage, ParsedTask, TaskTable},
        reference::ParsedReference,
        tree::{Key, Table},
    },
    stage::{Kind, Port},
};

/// Resolves a parsed pipeline and checks how its stages are connected.
/// `programs` is the folder in which programs that the pipeline names run.
pub(crate) fn resolve(
    parsed: ParsedPipeline,
    programs: Option<PathBuf>,
    kinds: &'static [Kind],
    mistakes: &mut Vec<Diagnostic>,
) -> Pipeline {
    let names: Vec<String> = parsed.stages.iter().map(|stage| stage.name.text.clone()).collect();
    let stages: Vec<Stage> = parsed.stages.into_iter().map(|one| stage(one, &names, kinds, mistakes)).collect();
    let axes = axes::resolve(parsed.axes, &stages, mistakes);
    let mut pipeline = Pipeline {
        name: parsed.name,
        description: parsed.description,
        labels: parsed.labels,
        seed: parsed.seed,
        preset: parsed.preset,
        task: task(parsed.task, &axes, &parsed.start, mistakes),
        programs,
        rounds: parsed.rounds,
        stages,
        axes,
    };
    let rounds = pipeline.rounds();
    wiring::check(&mut pipeline.stages, rounds, kinds, mistakes);
    streams::check(&pipeline, mistakes);
    pipeline
}

/// The task. A file may leave it to the axes of the matrix.
fn task(parsed: ParsedTask, axes: &[Axis], start: &Span, mistakes: &mut Vec<Diagnostic>) -> Option<TaskTable> {
    match parsed {
        ParsedTask::Written(table) => Some(table),
        ParsedTask::Unreadable => None,
        ParsedTask::Missing => {
            let axis = axes.iter().find(|axis| matches!(axis.target, Target::Task(_)));
            if axis.is_none() {
                let mistake = Diagnostic::at(start.clone(), "the pipeline has no `[task]`");
                mistakes.push(mistake.help("write `[task]` with `env = \"planar\"`"));
            }
            axis.map(|axis| TaskTable { table: Table::default(), span: axis.span.clone() })
        }
    }
}

fn stage(parsed: ParsedStage, names: &[String], kinds: &'static [Kind], mistakes: &mut Vec<Diagnostic>) -> Stage {
    let kind = kind(&parsed, kinds, mistakes);
    let ports = parsed.inputs.iter().map(|input| input.port.text.as_str());
    let kind = kind.map(|kind| kind.declared(&Value::Object(parsed.params.to_json()), ports));
    let count = parsed.inputs.len();
    let inputs = parsed.inputs.into_iter().filter_map(|one| input(one, kind, names, mistakes));
    let inputs: Vec<Input> = inputs.collect();
    Stage {
        name: parsed.name.text,
        span: parsed.name.span,
        kind,
        params: parsed.params,
        first: parsed.first,
        from: parsed.from,
        loop_broken: parsed.loop_broken,
        stream: parsed.stream,
        inputs_broken: parsed.inputs_broken || inputs.len() < count,
        inputs,
    }
}

fn kind(stage: &ParsedStage, kinds: &'static [Kind], mistakes: &mut Vec<Diagnostic>) -> Option<&'static Kind> {
    let names = || kinds.iter().map(|kind| kind.name);
    match &stage.kind {
        ParsedKind::Unreadable => None,
        ParsedKind::Missing => {
            let mistake = Diagnostic::at(stage.name.span.clone(), format!("stage `{}` has no `kind`", stage.name.text));
            mistakes.push(mistake.help(format!("kinds: {}", names().collect::<Vec<_>>().join(", "))));
            None
        }
        ParsedKind::Named(Key { text, span }) => {
            let kind = kinds.iter().find(|kind| kind.name == text);
            if kind.is_none() {
                let mistake = Diagnostic::at(span.clone(), format!("unknown kind `{text}`"));
                mistakes.push(mistake.help(instead(text, "kinds", names())));
            }
            kind
        }
    }
}

fn input(
    parsed: ParsedInput,
    kind: Option<&'static Kind>,
    names: &[String],
    mistakes: &mut Vec<Diagnostic>,
) -> Option<Input> {
    let count = mistakes.len();
    let references = parsed.references.into_iter().filter_map(|one| {
        let found = reference(one, names);
        found.map_err(|mistake| mistakes.push(mistake)).ok()
    });
    let references: Vec<Reference> = references.collect();
    let broken = parsed.broken || mistakes.len() > count;
    let port = port(kind?, &parsed.port, mistakes)?;
    Some(Input { port, span: parsed.port.span, references, broken })
}

fn port(kind: &'static Kind, key: &Key, mistakes: &mut Vec<Diagnostic>) -> Option<&'static Port> {
    let name = key.text.as_str();
    let port = kind.ports.iter().find(|port| port.name == name);
    if port.is_none() {
        let mistake = Diagnostic::at(key.span.clone(), format!("`{}` has no input `{name}`", kind.name));
        mistakes.push(mistake.help(instead(name, "inputs", kind.ports.iter().map(|port| port.name))));
    }
    port
}

fn reference(parsed: ParsedReference, names: &[String]) -> Result<Reference, Diagnostic> {
    let ParsedReference { name, rounds, gathers, span, text } = parsed;
    let Some(stage) = names.iter().position(|known| *known == name) else {
        let mistake = Diagnostic::at(span, format!("there is no stage `{name}`"));
        return Err(mistake.help(instead(&name, "stages", names.iter().map(String::as_str))));
    };
    Ok(Reference { stage, rounds, gathers, span, text })
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
