//! The grammar of references: `name`, `name@prev|sofar|last|all|3`, each with `[*]` for all points of the matrix.

use crate::diag::{Diagnostic, Span, instead};

/// A reference to results of a stage. The stage is not looked up yet.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct ParsedReference {
    /// The stage.
    pub(crate) name: String,
    pub(crate) rounds: RoundSelector,
    /// `[*]`: from all points of the matrix.
    pub(crate) gathers: bool,
    pub(crate) span: Span,
    /// The reference as written.
    pub(crate) text: String,
}

/// The rounds that a reference means.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum RoundSelector {
    /// `name`: this round, or the one result of a stage outside of the loop.
    Same,
    /// `name@prev`: the round before.
    Previous,
    /// `name@sofar`: this round and all rounds before it.
    SoFar,
    /// `name@last`: the last round of the loop.
    Last,
    /// `name@all`: all rounds.
    All,
    /// `name@3`.
    Round(u32),
}

/// Reads a reference.
pub(crate) fn reference(text: &str, span: Span) -> Result<ParsedReference, Diagnostic> {
    let (rest, gathers) = match text.strip_suffix("[*]") {
        Some(rest) => (rest, true),
        None => (text, false),
    };
    if rest.contains(['[', ']']) {
        let mistake = Diagnostic::at(span, format!("`{text}` picks points of the matrix, which only `[*]` can"));
        return Err(mistake.help("write `[*]` for all points, or leave it out for this node's own point"));
    }
    let (name, selector) = match rest.split_once('@') {
        Some((name, selector)) => (name, Some(selector)),
        None => (rest, None),
    };
    if name.is_empty() {
        return Err(Diagnostic::at(span, "a reference names a stage").help("write `stage` or `stage@prev`"));
    }
    let rounds = match selector {
        None => RoundSelector::Same,
        Some("prev") => RoundSelector::Previous,
        Some("sofar") => RoundSelector::SoFar,
        Some("last") => RoundSelector::Last,
        Some("all") => RoundSelector::All,
        Some(number) => match number.parse() {
            Ok(round) if number.bytes().all(|byte| byte.is_ascii_digit()) => RoundSelector::Round(round),
            _ => return Err(unknown_selector(number, span)),
        },
    };
    Ok(ParsedReference { name: name.to_owned(), rounds, gathers, span, text: text.to_owned() })
}

fn unknown_selector(selector: &str, span: Span) -> Diagnostic {
    let selector = format!("@{selector}");
    let help = instead(&selector, "rounds are written", ["@prev", "@sofar", "@last", "@all", "@3"]);
    Diagnostic::at(span, format!("`{selector}` is no round")).help(help)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_form_is_read() {
        let read = |text| reference(text, 0..0).map(|read| (read.name, read.rounds, read.gathers)).ok();
        let form = |rounds, gathers| Some(("a".to_owned(), rounds, gathers));
        assert_eq!(read("a"), form(RoundSelector::Same, false));
        assert_eq!(read("a@prev"), form(RoundSelector::Previous, false));
        assert_eq!(read("a@sofar"), form(RoundSelector::SoFar, false));
        assert_eq!(read("a@all"), form(RoundSelector::All, false));
        assert_eq!(read("a@12"), form(RoundSelector::Round(12), false));
        assert_eq!(read("a@last[*]"), form(RoundSelector::Last, true));
        for wrong in ["", "@prev", "a@", "a@+3", "a@soon", "a[seed=2]", "a@99999999999"] {
            assert_eq!(read(wrong), None, "{wrong}");
        }
    }
}
