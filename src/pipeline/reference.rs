//! The grammar of references: `name`, `name@prev|sofar|last|all|3`, each with `[*]` for all points of the matrix.

use super::{draft::Which, wording::instead};
use crate::diag::{Diagnostic, Span};

/// A reference, read but not yet looked up.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Spelled<'a> {
    pub(super) name: &'a str,
    pub(super) which: Which,
    pub(super) gathers: bool,
}

/// Reads a reference.
pub(super) fn spell(text: &str, span: Span) -> Result<Spelled<'_>, Diagnostic> {
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
    let which = match selector {
        None => Which::Same,
        Some("prev") => Which::Previous,
        Some("sofar") => Which::SoFar,
        Some("last") => Which::Last,
        Some("all") => Which::All,
        Some(number) => match number.parse() {
            Ok(round) if number.bytes().all(|byte| byte.is_ascii_digit()) => Which::Round(round),
            _ => return Err(unknown_selector(number, span)),
        },
    };
    Ok(Spelled { name, which, gathers })
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
        let read = |text| spell(text, 0..0).map(|read| (read.name, read.which, read.gathers)).ok();
        assert_eq!(read("a"), Some(("a", Which::Same, false)));
        assert_eq!(read("a@prev"), Some(("a", Which::Previous, false)));
        assert_eq!(read("a@sofar"), Some(("a", Which::SoFar, false)));
        assert_eq!(read("a@all"), Some(("a", Which::All, false)));
        assert_eq!(read("a@12"), Some(("a", Which::Round(12), false)));
        assert_eq!(read("a@last[*]"), Some(("a", Which::Last, true)));
        for wrong in ["", "@prev", "a@", "a@+3", "a@soon", "a[seed=2]", "a@99999999999"] {
            assert_eq!(read(wrong), None, "{wrong}");
        }
    }
}
