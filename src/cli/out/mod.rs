//! Output to the terminal. All text of the program goes out here: it is made safe, and a write that fails is remembered.

mod format;
mod style;

use std::{
    io::{self, ErrorKind, Write as _},
    sync::OnceLock,
};

use anstream::{AutoStream, ColorChoice};
use clap::builder::StyledStr;

use crate::diag::is_hidden;

pub(crate) use format::{bytes, command, duration, number, tidy};
pub(crate) use style::{bold, dim, green, red, table, yellow};

/// Why standard output could not be written; the first such error.
static LOST: OnceLock<io::Error> = OnceLock::new();

/// Sets when both streams keep colours. `auto` keeps them on a terminal that has them, unless `NO_COLOR` is set.
pub(crate) fn set_colour(choice: clap::ColorChoice) {
    match choice {
        clap::ColorChoice::Auto => ColorChoice::Auto,
        clap::ColorChoice::Always => ColorChoice::Always,
        clap::ColorChoice::Never => ColorChoice::Never,
    }
    .write_global();
}

/// Writes text to standard output.
pub(crate) fn print(text: &str) {
    write(&style::painted(text, AutoStream::choice(&io::stdout()) != ColorChoice::Never));
}

/// Writes a line to standard output.
pub(crate) fn line(text: &str) {
    print(&format!("{text}\n"));
}

/// Writes a value to standard output, as JSON on one line.
pub(crate) fn json(value: &serde_json::Value) {
    json_text(&value.to_string());
}

/// Writes JSON on one line to standard output. Hidden characters become the escapes of JSON, which mean the same.
pub(crate) fn json_text(json: &str) {
    let escape = |c: char| if is_hidden(c) { format!("\\u{:04x}", c as u32) } else { c.to_string() };
    match json.contains(is_hidden) {
        true => line(&json.chars().map(escape).collect::<String>()),
        false => line(json),
    }
}

/// Writes text that the program itself has made, such as a completion script, as it is.
pub(crate) fn script(text: &str) {
    write(text);
}

/// Writes what clap says: help to standard output, mistakes to standard error.
pub(crate) fn of_clap(error: &clap::Error) {
    let rendered: StyledStr = error.render();
    if error.use_stderr() {
        note_coloured(rendered.ansi().to_string().trim_end_matches('\n'));
    } else {
        let colours = AutoStream::choice(&io::stdout()) != ColorChoice::Never;
        write(&style::coloured_by_others(&rendered.ansi().to_string(), colours));
    }
}

/// Writes to standard output, or remembers why that failed. A reader that has seen enough, such as `head`, closes the
/// pipe: that is no failure.
fn write(text: &str) {
    let mut out = io::stdout().lock();
    if let Err(error) = out.write_all(text.as_bytes()).and_then(|()| out.flush())
        && error.kind() != ErrorKind::BrokenPipe
    {
        let _ = LOST.set(error);
    }
}

/// Why output was lost, if it was.
pub(crate) fn lost() -> Option<&'static io::Error> {
    LOST.get()
}

/// Writes a line to standard error. Nothing can be said where that fails.
pub(crate) fn note(text: &str) {
    let _ = writeln!(io::stderr().lock(), "{}", for_stderr(text));
}

/// Writes a line that a library has coloured to standard error.
pub(crate) fn note_coloured(text: &str) {
    let _ = writeln!(io::stderr().lock(), "{}", style::coloured_by_others(text, stderr_has_colours()));
}

/// The text as standard error shows it: safe, with colours or without. For text that another writer puts there.
pub(crate) fn for_stderr(text: &str) -> String {
    style::painted(text, stderr_has_colours())
}

/// Whether standard error shows colours.
pub(crate) fn stderr_has_colours() -> bool {
    AutoStream::choice(&io::stderr()) != ColorChoice::Never
}
