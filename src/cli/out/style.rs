//! Styles of text. A style is a marker until the text reaches a terminal, so that only our own styles colour it: an
//! escape sequence that a user wrote is shown, not obeyed.

use anstyle::{AnsiColor, Style};

use crate::diag::{is_hidden, visible};

/// The markers: characters that Unicode keeps free for such use.
const PLAIN: char = '\u{fdd0}';
const BOLD: char = '\u{fdd1}';
const DIM: char = '\u{fdd2}';
const RED: char = '\u{fdd3}';
const GREEN: char = '\u{fdd4}';
const YELLOW: char = '\u{fdd5}';

pub(crate) fn bold(text: &str) -> String {
    styled(BOLD, text)
}

pub(crate) fn dim(text: &str) -> String {
    styled(DIM, text)
}

pub(crate) fn red(text: &str) -> String {
    styled(RED, text)
}

pub(crate) fn green(text: &str) -> String {
    styled(GREEN, text)
}

pub(crate) fn yellow(text: &str) -> String {
    styled(YELLOW, text)
}

/// A styled text has one line, whatever it names.
fn styled(marker: char, text: &str) -> String {
    format!("{marker}{}{PLAIN}", visible(text))
}

/// The text as a terminal shall get it: markers become styles, or nothing without colours; hidden characters become
/// visible, except line feeds.
pub(super) fn painted(text: &str, colours: bool) -> String {
    let mut painted = String::with_capacity(text.len());
    for c in text.chars() {
        match style(c) {
            Some(style) if colours && c == PLAIN => painted.push_str(&format!("{style:#}")),
            Some(style) if colours => painted.push_str(&style.to_string()),
            Some(_) => {}
            None if is_hidden(c) && c != '\n' => painted.extend(c.escape_default()),
            None => painted.push(c),
        }
    }
    painted
}

fn style(marker: char) -> Option<Style> {
    Some(match marker {
        PLAIN | BOLD => Style::new().bold(),
        DIM => Style::new().dimmed(),
        RED => AnsiColor::Red.on_default().bold(),
        GREEN => AnsiColor::Green.on_default(),
        YELLOW => AnsiColor::Yellow.on_default(),
        _ => return None,
    })
}

/// Text that a library has coloured: its colours stay, other hidden characters become visible.
pub(super) fn coloured_by_others(text: &str, colours: bool) -> String {
    if !colours {
        return painted(&anstream::adapter::strip_str(text).to_string(), false);
    }
    let mut safe = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(c) = rest.chars().next() {
        let length = colour_length(rest).unwrap_or(c.len_utf8());
        let (part, after) = rest.split_at(length);
        safe.push_str(&if length > c.len_utf8() { part.to_owned() } else { painted(part, false) });
        rest = after;
    }
    safe
}

/// The length of the colour sequence that a text begins with: `ESC [`, digits and semicolons, `m`.
fn colour_length(text: &str) -> Option<usize> {
    let rest = text.strip_prefix("\u{1b}[")?;
    let end = rest.find(|c: char| !c.is_ascii_digit() && c != ';')?;
    rest[end..].starts_with('m').then_some(end + 3)
}

/// Aligns rows in columns with two spaces between them. A cell has one line.
pub(crate) fn table(rows: &[Vec<String>]) -> String {
    let rows: Vec<Vec<_>> = rows.iter().map(|row| row.iter().map(|cell| visible(cell)).collect()).collect();
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let widths: Vec<usize> = (0..columns)
        .map(|at| rows.iter().filter_map(|row| row.get(at)).map(|cell| width(cell)).max().unwrap_or(0))
        .collect();
    let mut text = String::new();
    for row in &rows {
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
    cell.chars().filter(|c| style(*c).is_none()).count()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_do_not_shift_columns() {
        let rows = vec![vec![red("a"), "x".into()], vec!["bbb".into(), "y".into()]];
        assert_eq!(painted(&table(&rows), false), "a    x\nbbb  y\n");
        assert_eq!(painted(&table(&rows), true), "\u{1b}[1m\u{1b}[31ma\u{1b}[0m    x\nbbb  y\n");
    }

    #[test]
    fn a_cell_that_holds_a_line_feed_breaks_no_table() {
        let rows = vec![vec!["a\n\u{1b}[2J".into(), "x".into()], vec!["b".into(), "y".into()]];
        assert_eq!(painted(&table(&rows), true), "a\\n\\u{1b}[2J  x\nb             y\n");
    }

    #[test]
    fn only_colours_of_a_library_are_obeyed() {
        let text = "\u{1b}[1;31mred\u{1b}[0m \u{1b}[2J \u{1b}]0;title\u{7} \u{1b}";
        let safe = "\u{1b}[1;31mred\u{1b}[0m \\u{1b}[2J \\u{1b}]0;title\\u{7} \\u{1b}";
        assert_eq!(coloured_by_others(text, true), safe);
        assert!(!coloured_by_others(text, false).contains(is_hidden));
    }

    proptest::proptest! {
        #[test]
        fn nothing_hidden_goes_out_whatever_comes_in(bytes: Vec<u8>, text in r"\PC*\x1b?\[?[0-9;]*m?\n?.*") {
            for text in [String::from_utf8_lossy(&bytes).into_owned(), text] {
                let told = [bold(&text), text.clone(), table(&[vec![text.clone(), red(&text)]])].concat();
                proptest::prop_assert!(!painted(&told, false).contains(|c| is_hidden(c) && c != '\n'));
                proptest::prop_assert!(!coloured_by_others(&text, false).contains(|c| is_hidden(c) && c != '\n'));
                proptest::prop_assert_eq!(table(&[vec![text]]).lines().count(), 1);
            }
        }
    }
}
