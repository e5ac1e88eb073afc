//! The texts that a user wrote, and places in them.

use std::ops::Range;

/// A place in [`Sources`]: a range of bytes, counted from the start of the first text. One number therefore names both
/// the text and the place in it.
pub type Span = Range<usize>;

/// The texts that mistakes are underlined in: files, and command-line arguments that change them.
#[derive(Debug, Clone, Default)]
pub struct Sources(Vec<SourceText>);

/// One text.
#[derive(Debug, Clone)]
pub(super) struct SourceText {
    /// Its name in messages, such as the path of a file.
    pub(super) shown: String,
    pub(super) text: String,
    /// Where its spans begin.
    base: usize,
}

impl Sources {
    /// Adds a text and returns the place where its spans begin.
    pub fn add(&mut self, shown: impl Into<String>, text: impl Into<String>) -> usize {
        // One byte lies between two texts, so that the end of one is not the start of the next.
        let base = self.0.last().map_or(0, |last| last.base + last.text.len() + 1);
        self.0.push(SourceText { shown: shown.into(), text: text.into(), base });
        base
    }

    /// The text at a place.
    pub fn slice(&self, span: &Span) -> Option<&str> {
        let source = self.source(span)?;
        source.text.get(span.start - source.base..span.end.checked_sub(source.base)?)
    }

    fn source(&self, span: &Span) -> Option<&SourceText> {
        self.0.iter().rev().find(|source| source.base <= span.start)
    }

    /// The text that a span lies in and the span within that text, cut to whole characters.
    pub(super) fn locate(&self, span: &Span) -> Option<(&SourceText, Span)> {
        let source = self.source(span)?;
        let whole = |at: usize| {
            let at = at.saturating_sub(source.base).min(source.text.len());
            (0..=at).rev().find(|at| source.text.is_char_boundary(*at)).unwrap_or(0)
        };
        let (start, end) = (whole(span.start), whole(span.end));
        Some((source, start..end.max(start)))
    }
}

/// Line and column of a byte. Both count from 1, columns in characters.
pub fn line_and_column(text: &str, at: usize) -> (usize, usize) {
    let before = &text[..at];
    let line_start = before.rfind('\n').map_or(0, |newline| newline + 1);
    (before.matches('\n').count() + 1, before[line_start..].chars().count() + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_count_characters() {
        assert_eq!(line_and_column("a\nü = x", "a\nü = ".len()), (2, 5));
    }

    #[test]
    fn a_span_belongs_to_the_text_it_begins_in() {
        let mut sources = Sources::default();
        sources.add("a", "one");
        let base = sources.add("b", "two");
        assert_eq!(sources.slice(&(0..3)), Some("one"));
        assert_eq!(sources.slice(&(base..base + 3)), Some("two"));
        assert_eq!(sources.locate(&(3..3)).map(|found| found.1), Some(3..3));
    }
}
