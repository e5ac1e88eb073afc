//! Mistakes in what a user wrote, underlined where they stand, all at once: as text for a terminal or as JSON.

use std::{fmt, ops::Range};

use annotate_snippets::{AnnotationKind, Group, Level, Renderer, Snippet, renderer::DecorStyle};
use serde_json::{Value, json};

/// A place in [`Sources`]: bytes from the start of the first source, so that one number names source and offset.
pub type Span = Range<usize>;

/// The texts that mistakes are underlined in: a file, and each argument that changes it.
#[derive(Debug, Clone, Default)]
pub struct Sources(Vec<SourceText>);

#[derive(Debug, Clone)]
struct SourceText {
    shown: String,
    text: String,
    base: usize,
}

impl Sources {
    /// Adds a text and says where its spans begin.
    pub fn add(&mut self, shown: impl Into<String>, text: impl Into<String>) -> usize {
        // One byte lies between two texts, so that the end of one is not the start of the next.
        let base = self.0.last().map_or(0, |last| last.base + last.text.len() + 1);
        self.0.push(SourceText { shown: shown.into(), text: text.into(), base });
        base
    }

    /// The texts, each with the base of its spans, in the order they were added.
    pub fn texts(&self) -> impl Iterator<Item = (usize, &str)> {
        self.0.iter().map(|source| (source.base, source.text.as_str()))
    }

    /// What stands at a place.
    pub fn slice(&self, span: &Span) -> Option<&str> {
        let source = self.source(span)?;
        source.text.get(span.start - source.base..span.end.checked_sub(source.base)?)
    }

    fn source(&self, span: &Span) -> Option<&SourceText> {
        self.0.iter().rev().find(|source| source.base <= span.start)
    }

    /// The source of a span and the span within it, cut to whole characters of it.
    fn locate(&self, span: &Span) -> Option<(&SourceText, Span)> {
        let source = self.source(span)?;
        let whole = |at: usize| {
            let at = at.saturating_sub(source.base).min(source.text.len());
            (0..=at).rev().find(|at| source.text.is_char_boundary(*at)).unwrap_or(0)
        };
        let (start, end) = (whole(span.start), whole(span.end));
        Some((source, start..end.max(start)))
    }
}

/// One mistake.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Diagnostic {
    /// A lower-case clause with user text in backticks.
    pub message: String,
    /// Where; without a place it concerns the whole.
    pub span: Option<Span>,
    /// A few words under the underlined place.
    pub label: Option<String>,
    /// The next step.
    pub help: Option<String>,
}

impl Diagnostic {
    /// A mistake at a place.
    pub fn at(span: Span, message: impl Into<String>) -> Self {
        Self { message: message.into(), span: Some(span), label: None, help: None }
    }

    /// A mistake without a place.
    pub fn general(message: impl Into<String>) -> Self {
        Self { message: message.into(), span: None, label: None, help: None }
    }

    /// Says a few words under the place.
    #[must_use]
    pub fn label(mut self, label: impl Into<String>) -> Self {
        self.label = Some(label.into());
        self
    }

    /// Names the next step.
    #[must_use]
    pub fn help(mut self, help: impl Into<String>) -> Self {
        self.help = Some(help.into());
        self
    }
}

/// Every mistake of one reading, with the texts they stand in.
#[derive(Debug, Clone)]
pub struct Diagnostics {
    sources: Sources,
    list: Vec<Diagnostic>,
}

impl Diagnostics {
    /// Mistakes in the order of their places, each once.
    pub fn new(sources: Sources, mut list: Vec<Diagnostic>) -> Self {
        list.sort_by_key(|one| one.span.clone().map(|span| (span.start, span.end)));
        let mut kept: Vec<Diagnostic> = Vec::with_capacity(list.len());
        for one in list {
            let same_place = kept.iter().rev().take_while(|other| other.span == one.span);
            if same_place.into_iter().all(|other| other.message != one.message) {
                kept.push(one);
            }
        }
        Self { sources, list: kept }
    }

    /// The mistakes of several readings as those of one: a text that several of them read counts once.
    pub fn join(all: impl IntoIterator<Item = Self>) -> Self {
        let (mut sources, mut list) = (Sources::default(), Vec::new());
        for Self { sources: own, list: mistakes } in all {
            let mut moves = Vec::new();
            for source in own.0 {
                let known = sources.0.iter().find(|it| it.shown == source.shown && it.text == source.text);
                let base = known.map(|known| known.base);
                let base = base.unwrap_or_else(|| sources.add(source.shown, source.text));
                moves.push((source.base, base));
            }
            list.extend(mistakes.into_iter().map(|mut one| {
                if let Some(span) = &mut one.span
                    && let Some((from, to)) = moves.iter().rev().find(|(from, _)| *from <= span.start)
                {
                    *span = span.start - from + to..span.end - from + to;
                }
                one
            }));
        }
        Self::new(sources, list)
    }

    /// The mistakes.
    pub fn list(&self) -> &[Diagnostic] {
        &self.list
    }

    /// The mistakes as text, with colours or without, followed by their number where there are several.
    pub fn render(&self, colour: bool) -> String {
        let renderer = if colour { Renderer::styled() } else { Renderer::plain() };
        let renderer = renderer.decor_style(DecorStyle::Ascii).term_width(120);
        let mut text: Vec<String> = self.list.iter().map(|one| renderer.render(&[self.group(one)])).collect();
        if self.list.len() > 1 {
            text.push(
                renderer
                    .render(&[Group::with_title(Level::ERROR.primary_title(format!("{} mistakes", self.list.len())))]),
            );
        }
        text.join("\n\n") + "\n"
    }

    fn group<'a>(&'a self, one: &'a Diagnostic) -> Group<'a> {
        let mut group = Group::with_title(Level::ERROR.primary_title(visible(&one.message)));
        if let Some((source, span)) = one.span.as_ref().and_then(|span| self.sources.locate(span)) {
            let mark = AnnotationKind::Primary.span(span).label(one.label.as_deref().map(visible));
            group = group.element(Snippet::source(&source.text).path(visible(&source.shown)).annotation(mark));
        }
        match &one.help {
            Some(help) => group.element(Level::HELP.message(visible(help))),
            None => group,
        }
    }

    /// The mistakes for programs: source, line and column count from 1, columns in characters.
    pub fn to_json(&self) -> Value {
        self.list.iter().map(|one| self.json_of(one)).collect()
    }

    fn json_of(&self, one: &Diagnostic) -> Value {
        let place = one.span.as_ref().and_then(|span| self.sources.locate(span));
        let place = place.map(|(source, span)| {
            let (line, column) = line_and_column(&source.text, span.start);
            let (end_line, end_column) = line_and_column(&source.text, span.end);
            (&source.shown, line, column, end_line, end_column)
        });
        json!({
            "message": one.message,
            "source": place.map(|place| place.0),
            "line": place.map(|place| place.1),
            "column": place.map(|place| place.2),
            "end_line": place.map(|place| place.3),
            "end_column": place.map(|place| place.4),
            "label": one.label,
            "help": one.help,
        })
    }
}

impl fmt::Display for Diagnostics {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.render(false).trim_end())
    }
}

impl std::error::Error for Diagnostics {}

/// Text that cannot move the cursor or colour a terminal: control characters are written as escapes.
fn visible(text: &str) -> String {
    let mut shown = String::with_capacity(text.len());
    for c in text.chars() {
        if c.is_control() { shown.extend(c.escape_default()) } else { shown.push(c) }
    }
    shown
}

/// Line and column of a byte, both from 1.
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

    #[test]
    fn escape_sequences_never_reach_the_terminal() {
        let one = Diagnostic::general("unknown kind `\u{1b}[31m`");
        assert!(!Diagnostics::new(Sources::default(), vec![one]).render(false).contains('\u{1b}'));
    }
}
