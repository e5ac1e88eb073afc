//! Text of a user, made safe to show.

use std::borrow::Cow;

/// True for a character that could move the cursor, colour the terminal, break a line, or reorder text: control
/// characters, line separators and the marks of bidirectional text.
pub fn is_hidden(c: char) -> bool {
    c.is_control()
        || matches!(c, '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

/// The text with every hidden character written as an escape, such as `\n` or `\u{1b}`.
pub fn visible(text: &str) -> Cow<'_, str> {
    if !text.contains(is_hidden) {
        return Cow::Borrowed(text);
    }
    let mut shown = String::with_capacity(text.len() + 8);
    for c in text.chars() {
        if is_hidden(c) { shown.extend(c.escape_default()) } else { shown.push(c) }
    }
    Cow::Owned(shown)
}

#[cfg(test)]
mod tests {
    use super::visible;

    #[test]
    fn hidden_characters_are_written_out_and_others_stay() {
        assert_eq!(visible("a\u{1b}[2J\n\u{9b}\u{202e}ü →"), "a\\u{1b}[2J\\n\\u{9b}\\u{202e}ü →");
    }
}
