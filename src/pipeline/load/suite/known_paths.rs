//! The paths that an argument can name in the members of a suite.

use crate::{
    diag::{Diagnostic, Span, instead},
    pipeline::syntax::{arguments::Argument, tree::Table},
};

/// What a path can begin with in a member.
#[derive(Debug, Default)]
pub(super) struct KnownPaths {
    stages: Vec<String>,
    has_loop: bool,
    /// The file cannot be read, which is reported. Every path may be right then.
    is_unknown: bool,
}

impl KnownPaths {
    /// The paths of a member, or `None` for a file that cannot be read.
    pub(super) fn of(document: Option<&Table>) -> Self {
        let Some(table) = document else { return Self { is_unknown: true, ..Self::default() } };
        let stages = table.get("stages").and_then(|stages| stages.value.as_table());
        let stages = stages.map(|table| table.keys().map(|key| key.text.clone()).collect());
        Self { stages: stages.unwrap_or_default(), has_loop: table.contains("loop"), is_unknown: false }
    }

    pub(super) fn has(&self, path: &str) -> bool {
        let head = head(path);
        let is_stage = self.stages.iter().any(|stage| stage == head);
        is_stage
            || self.is_unknown
            || matches!(head, "seed" | "preset" | "task")
            || (self.has_loop && matches!(head, "rounds" | "loop"))
    }
}

fn head(path: &str) -> &str {
    path.split('.').next().unwrap_or_default()
}

/// An argument as it concerns a member: `member.stage.param=1` concerns one, `stage.param=1` all that have the stage.
pub(super) fn of_member(argument: &Argument, member: &str, names: &[&str], known: &KnownPaths) -> Option<Argument> {
    match addressed(argument, names) {
        Some((name, rest)) => (name == member).then_some(rest),
        None => (argument.is_malformed() || known.has(argument.path())).then(|| argument.clone()),
    }
}

/// The member that an argument names before its path, and the argument without that name.
fn addressed<'a>(argument: &Argument, names: &[&'a str]) -> Option<(&'a str, Argument)> {
    let (head, rest) = argument.assignment.split_once(['.', '/'])?;
    let name = names.iter().find(|name| **name == head)?;
    let rest = Argument { assignment: rest.to_owned(), base: argument.base + head.len() + 1, ..*argument };
    Some((name, rest))
}

/// The mistake of an argument that concerns no member.
pub(super) fn unmatched(argument: &Argument, names: &[&str], known: &[KnownPaths]) -> Option<Diagnostic> {
    let path = argument.path();
    let concerns_one = addressed(argument, names).is_some() || known.iter().any(|known| known.has(path));
    if argument.is_malformed() || concerns_one {
        return None;
    }
    let at = argument.base + (argument.assignment.len() - argument.assignment.trim_start().len());
    Some(no_such_stage(at..at + head(path).len(), head(path), names, known))
}

/// The mistake of a path that begins with `head`.
pub(super) fn no_such_stage(span: Span, head: &str, names: &[&str], known: &[KnownPaths]) -> Diagnostic {
    let stages = known.iter().flat_map(|known| known.stages.iter().map(String::as_str));
    let mut heads: Vec<&str> = stages.chain(names.iter().copied()).chain(["seed", "preset", "task"]).collect();
    heads.sort_unstable();
    heads.dedup();
    let mistake = Diagnostic::at(span, format!("no pipeline of the suite has a stage `{head}`"));
    mistake.help(instead(head, "a path begins with one of", heads))
}
