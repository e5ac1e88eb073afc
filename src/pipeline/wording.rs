//! How mistakes are worded: names that a user probably meant, lists of names, and serde's sentences in ours.

use std::ops::Range;

use toml::de::DeValue;

use crate::diag::Diagnostic;

/// The candidate closest to `name`, if it is close enough to have been meant.
pub(super) fn near<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let allowed = (name.chars().count() / 3).max(1);
    candidates
        .into_iter()
        .map(|candidate| (strsim::damerau_levenshtein(name, candidate), candidate))
        .filter(|(distance, _)| *distance <= allowed)
        .min_by_key(|(distance, _)| *distance)
        .map(|(_, candidate)| candidate)
}

/// Help for a name that does not exist: the one probably meant, or all there are.
pub(super) fn instead<'a>(name: &str, what: &str, candidates: impl IntoIterator<Item = &'a str>) -> String {
    let candidates: Vec<&str> = candidates.into_iter().collect();
    match near(name, candidates.iter().copied()) {
        Some(meant) => format!("did you mean `{meant}`?"),
        None if candidates.is_empty() => format!("there are no {what}"),
        None => format!("{what}: {}", candidates.join(", ")),
    }
}

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

/// Words serde's mistake at `span` our way; `owner` has the field, such as "stage `represent`" or "`[task]`".
pub(super) fn of_serde(message: &str, span: Range<usize>, owner: &str, key: Option<&str>) -> Diagnostic {
    let quoted: Vec<&str> = message.split('`').skip(1).step_by(2).collect();
    if let Some(rest) = message.strip_prefix("unknown field `") {
        let name = rest.split('`').next().unwrap_or_default();
        let diagnostic = Diagnostic::at(span, format!("{owner} has no parameter `{name}`"));
        return diagnostic.label("unknown").help(instead(name, "parameters", quoted.into_iter().skip(1)));
    }
    if let Some(rest) = message.strip_prefix("unknown variant `") {
        let name = rest.split('`').next().unwrap_or_default();
        let message = match key {
            Some(key) => format!("`{key}` cannot be `{name}`"),
            None => format!("unknown choice `{name}`"),
        };
        return Diagnostic::at(span, message).help(instead(name, "choices", quoted.into_iter().skip(1)));
    }
    if let Some(rest) = message.strip_prefix("missing field `") {
        let name = rest.split('`').next().unwrap_or_default();
        return Diagnostic::at(span, format!("{owner} needs `{name}`")).help(format!("write `{name} = …`"));
    }
    for prefix in ["invalid type: ", "invalid value: "] {
        let Some((found, expected)) = message.strip_prefix(prefix).and_then(|rest| rest.split_once(", expected "))
        else {
            continue;
        };
        let subject = key.map_or_else(|| owner.to_owned(), |key| format!("`{key}`"));
        return Diagnostic::at(
            span,
            format!("{subject} takes {}, but is {}", plain_type(expected), plain_found(found)),
        );
    }
    let text = message.lines().next().unwrap_or_default();
    Diagnostic::at(span, key.map_or_else(|| format!("{owner}: {text}"), |key| format!("`{key}`: {text}")))
}

/// What a value is.
pub(super) fn what(value: &DeValue<'_>) -> &'static str {
    match value {
        DeValue::String(_) => "a text",
        DeValue::Integer(_) => "a whole number",
        DeValue::Float(_) => "a fraction",
        DeValue::Boolean(_) => "true or false",
        DeValue::Datetime(_) => "a date",
        DeValue::Array(_) => "a list",
        DeValue::Table(_) => "a table",
    }
}

fn plain_type(expected: &str) -> String {
    match expected {
        "u8" | "u16" | "u32" | "u64" | "usize" => "a whole number from 0 up".to_owned(),
        "i8" | "i16" | "i32" | "i64" | "isize" => "a whole number".to_owned(),
        "f32" | "f64" => "a number".to_owned(),
        "a nonzero u8" | "a nonzero u16" | "a nonzero u32" | "a nonzero u64" | "a nonzero usize" => {
            "a whole number from 1 up".to_owned()
        }
        "a boolean" => "true or false".to_owned(),
        "a string" => "a text".to_owned(),
        "a sequence" => "a list".to_owned(),
        other if other.starts_with("struct ") || other == "a map" => "a table".to_owned(),
        other => other.to_owned(),
    }
}

fn plain_found(found: &str) -> String {
    match found {
        "map" => "a table".to_owned(),
        "sequence" => "a list".to_owned(),
        other => match other.strip_prefix("string ").map(|text| text.trim_matches('"')) {
            Some(text) => format!("the text `{text}`"),
            None => format!(
                "the {}",
                other
                    .replace(" as i128", "")
                    .replace(" as u128", "")
                    .replace("floating point", "fraction")
                    .replace("integer", "number")
            ),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slip_of_the_finger_is_near_and_another_word_is_not() {
        assert_eq!(near("epoch", ["samples", "epochs"]), Some("epochs"));
        assert_eq!(near("represnet", ["represent"]), Some("represent"));
        assert_eq!(near("banana", ["samples", "epochs"]), None);
        assert_eq!(near("x", ["abc"]), None);
    }
}
