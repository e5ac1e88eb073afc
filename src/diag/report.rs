//! All mistakes of one reading, as text for a terminal or as JSON.

use std::fmt;

use annotate_snippets::{AnnotationKind, Group, Level, Renderer, Snippet, renderer::DecorStyle};
use serde_json::{Value, json};

use super::{
    mistake::Diagnostic,
    sources::{Sources, line_and_column},
    visible::visible,
};

/// All mistakes of one reading, with the texts that they stand in.
#[derive(Debug, Clone)]
pub struct Diagnostics {
    sources: Sources,
    list: Vec<Diagnostic>,
}

impl Diagnostics {
    /// Sorts mistakes by their places and keeps one of those that say the same at the same place.
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

    /// The mistakes.
    pub fn list(&self) -> &[Diagnostic] {
        &self.list
    }

    /// The mistakes as text, in colour or plain. Where there are several, their number follows.
    pub fn render(&self, colour: bool) -> String {
        let renderer = if colour { Renderer::styled() } else { Renderer::plain() };
        let renderer = renderer.decor_style(DecorStyle::Ascii).term_width(120);
        let mut text: Vec<String> = self.list.iter().map(|one| renderer.render(&[self.group(one)])).collect();
        if self.list.len() > 1 {
            let title = Level::ERROR.primary_title(format!("{} mistakes", self.list.len()));
            text.push(renderer.render(&[Group::with_title(title)]));
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

    /// The mistakes for programs. Lines and columns count from 1, columns in characters.
    pub fn to_json(&self) -> Value {
        self.list.iter().map(|one| self.json_of(one)).collect()
    }

    fn json_of(&self, one: &Diagnostic) -> Value {
        let mut json = json!({ "message": one.message, "source": null, "line": null, "column": null,
            "end_line": null, "end_column": null, "label": one.label, "help": one.help });
        if let Some((source, span)) = one.span.as_ref().and_then(|span| self.sources.locate(span)) {
            let (line, column) = line_and_column(&source.text, span.start);
            let (end_line, end_column) = line_and_column(&source.text, span.end);
            json["source"] = source.shown.as_str().into();
            json["line"] = line.into();
            json["column"] = column.into();
            json["end_line"] = end_line.into();
            json["end_column"] = end_column.into();
        }
        json
    }
}

impl fmt::Display for Diagnostics {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.render(false).trim_end())
    }
}

impl std::error::Error for Diagnostics {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn escape_sequences_never_reach_the_terminal() {
        let one = Diagnostic::general("unknown kind `\u{1b}[31m`");
        assert!(!Diagnostics::new(Sources::default(), vec![one]).render(false).contains('\u{1b}'));
    }
}
