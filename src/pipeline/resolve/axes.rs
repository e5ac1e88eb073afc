//! What each axis of the matrix varies.

use super::resolved::{Axis, Stage, Target};
use crate::{
    diag::{Diagnostic, instead},
    pipeline::syntax::{
        parsed::{AxisValue, ParsedAxis},
        path::{joined, span_of},
        tree::Key,
        values,
    },
};

/// Looks up the targets. An axis that varies nothing known or has no values is left out; the mistake is reported.
pub(super) fn resolve(parsed: Vec<ParsedAxis>, stages: &[Stage], mistakes: &mut Vec<Diagnostic>) -> Vec<Axis> {
    let mut axes = Vec::new();
    for ParsedAxis { name, span, path, mut values } in parsed {
        match target(&path, stages) {
            Ok(target) => {
                values.retain(|value| fits(value, &target, mistakes));
                axes.push(Axis { name, span, target, values });
            }
            Err(mistake) => mistakes.push(mistake),
        }
    }
    axes.retain(|axis| !axis.values.is_empty());
    axes
}

/// Whether a value can be a seed or a preset, where the axis varies them.
fn fits(value: &AxisValue, target: &Target, mistakes: &mut Vec<Diagnostic>) -> bool {
    let value = || Some(value.value.clone());
    match target {
        Target::Seed => values::whole::<u64>(value(), "seed", mistakes).is_some(),
        Target::Preset => values::preset(value(), mistakes).is_some(),
        Target::Task(_) | Target::Stage { .. } => true,
    }
}

fn target(path: &[Key], stages: &[Stage]) -> Result<Target, Diagnostic> {
    let words: Vec<&str> = path.iter().map(|part| part.text.as_str()).collect();
    let refuse = |message: String, help: String| Err(Diagnostic::at(span_of(path), message).help(help));
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
            format!("the axis `{}` names no parameter: there is no stage `{}`", joined(path), words[0]),
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

#[cfg(test)]
mod tests {
    use super::*;

    fn key(text: &str) -> Key {
        Key::new(text, 0..0)
    }

    #[test]
    fn an_axis_varies_seed_preset_task_or_a_stage() {
        assert_eq!(target(&[key("seed")], &[]), Ok(Target::Seed));
        assert_eq!(target(&[key("task"), key("noise")], &[]), Ok(Target::Task(vec![key("noise")])));
        assert!(target(&[key("task")], &[]).is_err());
        assert!(target(&[key("nobody"), key("epochs")], &[]).is_err());
    }
}
