//! Times, sizes, numbers and commands as text for people.

use crate::diag::is_hidden;

/// Removes the error numbers of the system, such as ` (os error 2)`.
pub(crate) fn tidy(text: &str) -> String {
    let mut words = text.split(" (os error ");
    let mut tidy = words.next().unwrap_or_default().to_owned();
    for rest in words {
        tidy.push_str(rest.split_once(')').map_or("", |(_, rest)| rest));
    }
    tidy
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

/// A command line, quoted so that a shell reads the same words. Bash and zsh read `$'\x1b'`, which stands for a hidden
/// character.
pub(crate) fn command(argv: &[String]) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_./=,:@+%".contains(c);
    let quote = |word: &String| match word {
        word if word.contains(is_hidden) => format!("$'{}'", word.chars().map(in_dollar_quotes).collect::<String>()),
        word if !word.is_empty() && word.chars().all(is_plain) => word.clone(),
        word => format!("'{}'", word.replace('\'', r"'\''")),
    };
    argv.iter().map(quote).collect::<Vec<_>>().join(" ")
}

fn in_dollar_quotes(c: char) -> String {
    match c {
        '\'' | '\\' => format!("\\{c}"),
        c if is_hidden(c) && c.is_ascii() => format!("\\x{:02x}", c as u32),
        c if is_hidden(c) => format!("\\u{:04x}", c as u32),
        c => c.to_string(),
    }
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
    fn a_command_can_be_pasted() {
        let argv = ["carl-pipe", "run", "a b.toml", "-S", "x=1", "it's\u{1b}"].map(str::to_owned);
        assert_eq!(command(&argv), r"carl-pipe run 'a b.toml' -S x=1 $'it\'s\x1b'");
    }
}
