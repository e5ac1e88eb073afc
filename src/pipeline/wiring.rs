//! Checks how stages are connected, as written: rounds that a reference can mean, types, and inputs left out.

use super::draft::{InputDraft, Reference, StageDraft, Which};
use crate::{
    diag::Diagnostic,
    stage::{Arity, Kind},
};

/// Reports every mistake of the connections, and marks the inputs that have one.
pub(super) fn check(stages: &mut [StageDraft<'_>], rounds: u32, kinds: &[Kind], mistakes: &mut Vec<Diagnostic>) {
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

fn round_mistake(
    reference: &Reference,
    taker: &StageDraft<'_>,
    giver: &StageDraft<'_>,
    rounds: u32,
) -> Option<Diagnostic> {
    if taker.loop_broken || giver.loop_broken {
        return None;
    }
    let (text, name, taker_name) = (&reference.text, &giver.name, &taker.name);
    let mistake = |message: String| Diagnostic::at(reference.span.clone(), message);
    match (giver.from, reference.which) {
        (None, Which::Same) => None,
        (None, _) => Some(
            mistake(format!("`{text}` names a round, but `{name}` is not in the loop")).help(format!("write `{name}`")),
        ),
        (Some(_), Which::Round(round)) if round >= rounds => Some(
            mistake(format!("`{text}` does not exist: the loop has rounds 0 to {}", rounds.saturating_sub(1)))
                .help(format!("write `{name}@last`, or raise `rounds`")),
        ),
        (Some(_), Which::Same | Which::Previous | Which::SoFar) if taker.from.is_none() => Some(
            mistake(format!("`{text}` does not say which round, and `{taker_name}` is not in the loop"))
                .help(format!("write `{name}@last`, `{name}@all` or `{name}@3`")),
        ),
        (Some(_), Which::Last | Which::All) if taker.from.is_some() => {
            let instead = if reference.which == Which::All { "sofar" } else { "prev" };
            Some(
                mistake(format!("`{text}` lies in the future of `{taker_name}`, which is in the loop itself"))
                    .help(format!("write `{name}@{instead}`")),
            )
        }
        _ => None,
    }
}

fn type_mistake(
    reference: &Reference,
    input: &InputDraft,
    stages: &[StageDraft<'_>],
    kinds: &[Kind],
) -> Option<Diagnostic> {
    let wanted = input.port.artifact;
    let giver = &stages[reference.stage];
    let given = giver.kind?.output;
    if given == wanted {
        return None;
    }
    let message = format!("input `{}` takes {wanted}, but `{}` gives {given}", input.port.name, giver.name);
    let mistake = Diagnostic::at(reference.span.clone(), message).label(format!("gives {given}"));
    Some(mistake.help(givers(wanted, stages, kinds)))
}

/// Which stages give an artifact, or else which kinds would.
fn givers(artifact: &str, stages: &[StageDraft<'_>], kinds: &[Kind]) -> String {
    let gives = |stage: &&StageDraft<'_>| stage.kind.is_some_and(|kind| kind.output == artifact);
    let names: Vec<&str> = stages.iter().filter(gives).map(|stage| stage.name.as_str()).collect();
    if !names.is_empty() {
        return format!("stages that give {artifact}: {}", names.join(", "));
    }
    let names: Vec<&str> = kinds.iter().filter(|kind| kind.output == artifact).map(|kind| kind.name).collect();
    format!("no stage gives {artifact}; kinds that do: {}", names.join(", "))
}

/// Required inputs that are not written.
fn missing(stage: &StageDraft<'_>, stages: &[StageDraft<'_>], kinds: &[Kind]) -> Vec<Diagnostic> {
    if stage.inputs_broken {
        return Vec::new();
    }
    let ports = stage.kind.map_or(&[][..], |kind| kind.ports);
    let required = ports.iter().filter(|port| port.arity != Arity::Optional);
    let left_out = required.filter(|port| stage.inputs.iter().all(|input| input.port.name != port.name));
    left_out
        .map(|port| {
            let message =
                format!("stage `{}` lacks the input `{}`, which takes {}", stage.name, port.name, port.artifact);
            let mistake = Diagnostic::at(stage.span.clone(), message);
            let givers = givers(port.artifact, stages, kinds);
            mistake.help(format!("write `inputs = {{ {} = \"…\" }}`; {givers}", port.name))
        })
        .collect()
}
