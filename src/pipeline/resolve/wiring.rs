//! Checks how stages are connected: rounds that references can mean, types of artifacts, and inputs left out.

use super::resolved::{Input, Reference, Stage};
use crate::{
    diag::Diagnostic,
    pipeline::syntax::reference::RoundSelector,
    stage::{Arity, Kind},
};

/// Reports every mistake in the connections and marks the inputs that have one.
pub(super) fn check(stages: &mut [Stage], rounds: u32, kinds: &[Kind], mistakes: &mut Vec<Diagnostic>) {
    for at in 0..stages.len() {
        let mut inputs = std::mem::take(&mut stages[at].inputs);
        for input in &mut inputs {
            let count = mistakes.len();
            for reference in &input.references {
                mistakes.extend(round_mistake(reference, &stages[at], &stages[reference.stage], rounds));
                mistakes.extend(type_mistake(reference, input, stages, kinds));
            }
            input.broken |= mistakes.len() > count;
        }
        stages[at].inputs = inputs;
        mistakes.extend(missing(&stages[at], stages, kinds));
    }
}

fn round_mistake(reference: &Reference, taker: &Stage, upstream: &Stage, rounds: u32) -> Option<Diagnostic> {
    if taker.loop_broken || upstream.loop_broken {
        return None;
    }
    let (text, name, taker_name) = (&reference.text, &upstream.name, &taker.name);
    let mistake = |message: String| Diagnostic::at(reference.span.clone(), message);
    match (upstream.from, reference.rounds) {
        (None, RoundSelector::Same) => None,
        (None, _) => Some(
            mistake(format!("`{text}` names a round, but `{name}` is not in the loop")).help(format!("write `{name}`")),
        ),
        (Some(_), RoundSelector::Round(round)) if round >= rounds => Some(
            mistake(format!("`{text}` does not exist: the loop has rounds 0 to {}", rounds.saturating_sub(1)))
                .help(format!("write `{name}@last`, or raise `rounds`")),
        ),
        (Some(_), RoundSelector::Same | RoundSelector::Previous | RoundSelector::SoFar) if taker.from.is_none() => {
            Some(
                mistake(format!("`{text}` does not say which round, and `{taker_name}` is not in the loop"))
                    .help(format!("write `{name}@last`, `{name}@all` or `{name}@3`")),
            )
        }
        (Some(_), RoundSelector::Last | RoundSelector::All) if taker.from.is_some() => {
            let instead = if reference.rounds == RoundSelector::All { "sofar" } else { "prev" };
            Some(
                mistake(format!("`{text}` lies in the future of `{taker_name}`, which is in the loop itself"))
                    .help(format!("write `{name}@{instead}`")),
            )
        }
        _ => None,
    }
}

fn type_mistake(reference: &Reference, input: &Input, stages: &[Stage], kinds: &[Kind]) -> Option<Diagnostic> {
    let wanted = input.port.artifact;
    let upstream = &stages[reference.stage];
    let kind = upstream.kind?;
    if kind.gives(wanted) {
        return None;
    }
    let given = kind.output;
    let message = format!("input `{}` takes {wanted}, but `{}` gives {given}", input.port.name, upstream.name);
    let mistake = Diagnostic::at(reference.span.clone(), message).label(format!("gives {given}"));
    Some(mistake.help(stages_that_give(wanted, stages, kinds)))
}

/// Which stages give an artifact, or else which kinds would.
fn stages_that_give(artifact: &str, stages: &[Stage], kinds: &[Kind]) -> String {
    let gives = |stage: &&Stage| stage.kind.is_some_and(|kind| kind.gives(artifact));
    let names: Vec<&str> = stages.iter().filter(gives).map(|stage| stage.name.as_str()).collect();
    if !names.is_empty() {
        return format!("stages that give {artifact}: {}", names.join(", "));
    }
    let names: Vec<&str> = kinds.iter().filter(|kind| kind.gives(artifact)).map(|kind| kind.name).collect();
    format!("no stage gives {artifact}; kinds that do: {}", names.join(", "))
}

/// Reports required inputs that are not written.
fn missing(stage: &Stage, stages: &[Stage], kinds: &[Kind]) -> Vec<Diagnostic> {
    if stage.inputs_broken {
        return Vec::new();
    }
    let required = stage.ports().iter().filter(|port| port.arity != Arity::Optional);
    let left_out = required.filter(|port| stage.inputs.iter().all(|input| input.port.name != port.name));
    left_out
        .map(|port| {
            let message =
                format!("stage `{}` lacks the input `{}`, which takes {}", stage.name, port.name, port.artifact);
            let mistake = Diagnostic::at(stage.span.clone(), message);
            let those = stages_that_give(port.artifact, stages, kinds);
            mistake.help(format!("write `inputs = {{ {} = \"…\" }}`; {those}", port.name))
        })
        .collect()
}
