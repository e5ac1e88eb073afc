//! Text for a terminal.

/// Breaks a line at spaces to fit 100 columns; what follows is indented.
pub(super) fn wrap(line: &str, indent: usize) -> String {
    const COLUMNS: usize = 100;
    let body = line.trim_start();
    let mut text = line[..line.len() - body.len()].to_owned();
    let mut column = text.chars().count();
    for (at, word) in body.split(' ').enumerate() {
        let width = word.chars().count();
        if at > 0 && column > indent && column + 1 + width > COLUMNS && !word.is_empty() {
            text.truncate(text.trim_end().len());
            text.push('\n');
            text.extend(std::iter::repeat_n(' ', indent));
            column = indent;
        } else if at > 0 {
            text.push(' ');
            column += 1;
        }
        text.push_str(word);
        column += width;
    }
    text
}
