//! Output to the terminal: streams that strip colours where none are wanted, styles, numbers, tables.

use std::io::Write as _;

use anstream::{ColorChoice, adapter::strip_str};
use anstyle::{AnsiColor, Style};

/// Sets when both streams keep colours. `auto` keeps them on a terminal, unless `NO_COLOR` is set.
pub(crate) fn set_colour(choice: clap::ColorChoice) {
    match choice {
        clap::ColorChoice::Auto => ColorChoice::Auto,
        clap::ColorChoice::Always => ColorChoice::Always,
        clap::ColorChoice::Never => ColorChoice::Never,
    }
    .write_global();
}

/// Writes to standard output. A failed write is ignored: a reader such as `head` may close the pipe, and the results of
/// the run are in the store.
pub(crate) fn print(text: &str) {
    let mut out = anstream::stdout().lock();
    let _ = out.write_all(text.as_bytes()).and_then(|()| out.flush());
}

/// Writes a line to standard output.
pub(crate) fn line(text: &str) {
    print(&format!("{text}\n"));
}

/// Writes a value to standard output, as JSON on one line.
pub(crate) fn json(value: &serde_json::Value) {
    line(&value.to_string());
}

/// Writes a line to standard error.
pub(crate) fn note(text: &str) {
    let _ = writeln!(anstream::stderr().lock(), "{text}");
}

/// The text as standard error would show it: with colours or without. For text that another writer puts there.
pub(crate) fn for_stderr(text: String) -> String {
    match anstream::AutoStream::choice(&std::io::stderr()) {
        ColorChoice::Never => strip_str(&text).to_string(),
        _ => text,
    }
}

/// Removes the error numbers of the system, such as ` (os error 2)`.
pub(crate) fn tidy(text: &str) -> String {
    let mut words = text.split(" (os error ");
    let mut tidy = words.next().unwrap_or_default().to_owned();
    for rest in words {
        tidy.push_str(rest.split_once(')').map_or("", |(_, rest)| rest));
    }
    tidy
}

fn styled(style: Style, text: &str) -> String {
    format!("{style}{text}{style:#}")
}

pub(crate) fn bold(text: &str) -> String {
    styled(Style::new().bold(), text)
}

pub(crate) fn dim(text: &str) -> String {
    styled(Style::new().dimmed(), text)
}

pub(crate) fn red(text: &str) -> String {
    styled(AnsiColor::Red.on_default().bold(), text)
}

pub(crate) fn green(text: &str) -> String {
    styled(AnsiColor::Green.on_default(), text)
}

pub(crate) fn yellow(text: &str) -> String {
    styled(AnsiColor::Yellow.on_default(), text)
}

/// `3 ms`, `12.3 s`, `4 min 05 s`, `2 h 03 min`.
pub(crate) fn duration(secs: f64) -> String {
    let whole = secs.round() as u64;
    match secs {
        _ if secs < 0.9995 => format!("{:.0} ms", secs * 1e3),
        _ if secs < 59.95 => format!("{secs:.1} s"),
        _ if whole < 3600 => format!("{} min {:02} s", whole / 60, whole % 60),
        _ => format!("{} h {:02} min", whole / 3600, whole / 60 % 60),
    }
}

/// `512 B`, `3.1 MB`.
pub(crate) fn bytes(count: u64) -> String {
    let mut value = count as f64;
    for unit in ["B", "kB", "MB", "GB"] {
        if value < 1000.0 {
            return if unit == "B" { format!("{count} B") } else { format!("{value:.1} {unit}") };
        }
        value /= 1000.0;
    }
    format!("{value:.1} TB")
}

/// A number with about three significant digits; whole numbers below 10⁹ have no fraction.
pub(crate) fn number(value: f64) -> String {
    match value.abs() {
        size if value.fract() == 0.0 && size < 1e9 => format!("{value:.0}"),
        size if (10.0..1e6).contains(&size) => format!("{value:.1}"),
        size if (0.01..10.0).contains(&size) => format!("{value:.3}"),
        _ => format!("{value:.2e}"),
    }
}

/// Aligns rows in columns with two spaces between them.
pub(crate) fn table(rows: &[Vec<String>]) -> String {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let widths: Vec<usize> = (0..columns)
        .map(|at| rows.iter().filter_map(|row| row.get(at)).map(|cell| width(cell)).max().unwrap_or(0))
        .collect();
    let mut text = String::new();
    for row in rows {
        let mut line = String::new();
        for (at, cell) in row.iter().enumerate() {
            line.push_str(cell);
            if row[at + 1..].iter().any(|cell| !cell.is_empty()) {
                line.push_str(&" ".repeat(widths[at] - width(cell) + 2));
            }
        }
        text.push_str(line.trim_end());
        text.push('\n');
    }
    text
}

/// The number of characters that a terminal shows.
fn width(cell: &str) -> usize {
    strip_str(cell).map(|part| part.chars().count()).sum()
}

/// A command line, quoted so that a shell reads the same words.
pub(crate) fn command(argv: &[String]) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_./=,:@+%".contains(c);
    let quote = |word: &String| {
        if !word.is_empty() && word.chars().all(is_plain) {
            word.clone()
        } else {
            format!("'{}'", word.replace('\'', r"'\''"))
        }
    };
    argv.iter().map(quote).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_read_well() {
        let told: Vec<_> = [0.0031, 0.9999, 12.34, 59.96, 245.0, 7380.0].map(duration).into();
        assert_eq!(told, ["3 ms", "1.0 s", "12.3 s", "1 min 00 s", "4 min 05 s", "2 h 03 min"]);
    }

    #[test]
    fn numbers_read_well() {
        let told: Vec<_> = [3072.0, 74.2345, 0.01234, 0.000_123, 1.0].map(number).into();
        assert_eq!(told, ["3072", "74.2", "0.012", "1.23e-4", "1"]);
    }

    #[test]
    fn colours_do_not_shift_columns() {
        let rows = vec![vec![red("a"), "x".into()], vec!["bbb".into(), "y".into()]];
        assert_eq!(table(&rows), "\x1b[1m\x1b[31ma\x1b[0m    x\nbbb  y\n");
    }

    #[test]
    fn a_command_can_be_pasted() {
        let argv = ["carl-pipe", "run", "a b.toml", "-S", "x=1"].map(str::to_owned);
        assert_eq!(command(&argv), "carl-pipe run 'a b.toml' -S x=1");
    }
}
