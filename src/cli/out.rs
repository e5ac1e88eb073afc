//! Words for a terminal: colour where wanted, durations, tables.

use std::io::{self, IsTerminal as _, Write as _};

/// Writes to standard output. A reader that went away, as `head` does, must not end a run: its results still count.
pub(crate) fn print(text: &str) {
    let mut out = io::stdout().lock();
    let _ = out.write_all(text.as_bytes()).and_then(|()| out.flush());
}

/// Writes a line to standard output.
pub(crate) fn line(text: &str) {
    print(&format!("{text}\n"));
}

/// Leaves out the numbers that the system gives its errors.
pub(crate) fn tidy(text: &str) -> String {
    let mut words = text.split(" (os error ");
    let mut tidy = words.next().unwrap_or_default().to_owned();
    for rest in words {
        tidy.push_str(rest.split_once(')').map_or("", |(_, rest)| rest));
    }
    tidy
}

/// Writes a line to standard error.
pub(crate) fn note(text: &str) {
    let _ = writeln!(io::stderr().lock(), "{text}");
}

/// When to colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Colour {
    /// On a terminal, unless `NO_COLOR` is set.
    Auto,
    /// Always.
    Always,
    /// Never.
    Never,
}

impl Colour {
    pub(crate) fn on_stdout(self) -> Paint {
        Paint(self.is_on(io::stdout().is_terminal()))
    }

    pub(crate) fn on_stderr(self) -> Paint {
        Paint(self.is_on(io::stderr().is_terminal()))
    }

    fn is_on(self, is_terminal: bool) -> bool {
        let set = |name| std::env::var_os(name).is_some_and(|value| !value.is_empty());
        match self {
            Self::Always => true,
            Self::Never => false,
            Self::Auto => !set("NO_COLOR") && (is_terminal || set("CLICOLOR_FORCE")),
        }
    }
}

/// Colours, or none.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Paint(pub(crate) bool);

impl Paint {
    fn with(self, code: &str, text: &str) -> String {
        if self.0 { format!("\x1b[{code}m{text}\x1b[0m") } else { text.to_owned() }
    }

    pub(crate) fn bold(self, text: &str) -> String {
        self.with("1", text)
    }

    pub(crate) fn dim(self, text: &str) -> String {
        self.with("2", text)
    }

    pub(crate) fn red(self, text: &str) -> String {
        self.with("1;31", text)
    }

    pub(crate) fn green(self, text: &str) -> String {
        self.with("32", text)
    }

    pub(crate) fn yellow(self, text: &str) -> String {
        self.with("33", text)
    }
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

/// A number for reading: whole numbers whole, others with as many digits as matter.
pub(crate) fn number(value: f64) -> String {
    match value.abs() {
        size if value.fract() == 0.0 && size < 1e9 => format!("{value:.0}"),
        size if (10.0..1e6).contains(&size) => format!("{value:.1}"),
        size if (0.01..10.0).contains(&size) => format!("{value:.3}"),
        _ => format!("{value:.2e}"),
    }
}

/// Lays rows out in columns, two spaces between; colours do not count as width.
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

fn width(cell: &str) -> usize {
    let mut count = 0;
    let mut chars = cell.chars();
    while let Some(next) = chars.next() {
        if next == '\x1b' {
            chars.by_ref().find(|c| *c == 'm');
        } else {
            count += 1;
        }
    }
    count
}

/// A command line that a shell reads back as it was.
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
        let rows = vec![vec![Paint(true).red("a"), "x".into()], vec!["bbb".into(), "y".into()]];
        assert_eq!(table(&rows), "\x1b[1;31ma\x1b[0m    x\nbbb  y\n");
    }

    #[test]
    fn a_command_can_be_pasted() {
        let argv = ["carl-pipe", "run", "a b.toml", "-S", "x=1"].map(str::to_owned);
        assert_eq!(command(&argv), "carl-pipe run 'a b.toml' -S x=1");
    }
}
