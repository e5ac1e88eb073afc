//! Bytes to a table: TOML is parsed here and nowhere else.

use toml::{
    Spanned,
    de::{DeTable, DeValue},
};

use super::tree::{Entry, Key, Table, Tree, Value};
use crate::{
    diag::{Diagnostic, Span, line_and_column},
    pipeline::limits::{MAX_BYTES, MAX_DEPTH, MAX_PARTS},
};

/// Reads the TOML of a file whose places begin at `base`.
///
/// A syntax error stops the reading. A number that is not finite is reported and left out.
pub(crate) fn document(bytes: &[u8], base: usize, mistakes: &mut Vec<Diagnostic>) -> Option<Table> {
    let table = text_of(bytes, base).and_then(|text| parsed(text, base, mistakes));
    table.map_err(|mistake| mistakes.push(mistake)).ok()
}

fn text_of(bytes: &[u8], base: usize) -> Result<&str, Diagnostic> {
    let text = std::str::from_utf8(bytes).map_err(|error| {
        let at = error.valid_up_to();
        let line = line_and_column(&String::from_utf8_lossy(&bytes[..at]), at).0;
        let message = format!("not UTF-8: byte {at} (0x{:02x}), in line {line}", bytes[at]);
        Diagnostic::at(base + at..base + at + 1, message).help("save the file as UTF-8 text")
    })?;
    if text.trim().is_empty() {
        let help = "begin with `schema = 1` and `name = \"…\"`";
        return Err(Diagnostic::at(base..base, "the file is empty").help(help));
    }
    if text.len() > MAX_BYTES {
        return Err(Diagnostic::at(base..base, format!("the file is too large: {} bytes", text.len())));
    }
    Ok(text)
}

fn parsed(text: &str, base: usize, mistakes: &mut Vec<Diagnostic>) -> Result<Table, Diagnostic> {
    if let Some(mistake) = too_many_parts(text, base) {
        return Err(mistake);
    }
    let parsed = DeTable::parse(text).map_err(|error| {
        let span = moved(error.span().unwrap_or(0..0), base);
        match error.message().lines().next().unwrap_or_default() {
            "duplicate key" => Diagnostic::at(span, "the key is given twice").help("keep one of the two"),
            message => Diagnostic::at(span, format!("not TOML: {message}")),
        }
    })?;
    let table = table(parsed.into_inner(), base, mistakes);
    let deep = table.iter().find(|entry| entry.value.value.depth() > MAX_DEPTH);
    deep.map_or(Ok(()), |entry| Err(too_deep(entry.key.span.clone())))?;
    Ok(table)
}

/// Reads one value, such as that of an argument; `None` where the text is not TOML.
pub(crate) fn value(text: &str, base: usize, mistakes: &mut Vec<Diagnostic>) -> Option<Option<Tree>> {
    DeValue::parse(text).ok().map(|value| tree(value, base, mistakes))
}

/// Refuses a dotted key of so many parts that walking the tree could outgrow the stack.
pub(crate) fn too_many_parts(text: &str, base: usize) -> Option<Diagnostic> {
    let (mut start, mut parts) = (0, 1);
    let mut previous = ' ';
    for (at, c) in text.char_indices() {
        match c {
            '.' if previous != '.' => parts += 1,
            '.' | '=' | ',' | '[' | ']' | '{' | '}' | '#' | '\n' => (start, parts) = (at + 1, 1),
            _ => {}
        }
        if parts > MAX_PARTS {
            return Some(too_deep(base + start..base + at));
        }
        previous = c;
    }
    None
}

fn too_deep(span: Span) -> Diagnostic {
    Diagnostic::at(span, "nested too deeply").help("no parameter lies that deep")
}

fn moved(span: Span, base: usize) -> Span {
    span.start + base..span.end + base
}

fn table(written: DeTable<'_>, base: usize, mistakes: &mut Vec<Diagnostic>) -> Table {
    let entries = written.into_iter().filter_map(|(key, value)| {
        let key = Key::new(key.get_ref().as_ref(), moved(key.span(), base));
        tree(value, base, mistakes).map(|value| Entry { key, value })
    });
    entries.collect()
}

/// The value with its places; `None` where it is a number that is not finite, which is reported.
fn tree(written: Spanned<DeValue<'_>>, base: usize, mistakes: &mut Vec<Diagnostic>) -> Option<Tree> {
    let span = moved(written.span(), base);
    let mut refuse = |number: &str, what: &str| {
        let mistake = Diagnostic::at(span.clone(), format!("`{number}` is {what}"));
        mistakes.push(mistake.help("write a finite number"));
        None
    };
    let value = match written.into_inner() {
        DeValue::String(text) => Value::Text(text.into_owned()),
        DeValue::Integer(number) => match i128::from_str_radix(number.as_str(), number.radix()) {
            Ok(number) => Value::Whole(number),
            Err(_) => return refuse(number.as_str(), "too large"),
        },
        DeValue::Float(number) => match number.as_str().parse::<f64>() {
            Ok(finite) if finite.is_finite() => Value::Fraction(finite),
            _ if number.as_str().contains(['n', 'i']) => {
                return refuse(number.as_str(), "not a number to compute with");
            }
            _ => return refuse(number.as_str(), "too large"),
        },
        DeValue::Boolean(boolean) => Value::Boolean(boolean),
        DeValue::Datetime(date) => Value::Date(date.to_string()),
        DeValue::Array(items) => Value::List(items.into_iter().filter_map(|item| tree(item, base, mistakes)).collect()),
        DeValue::Table(below) => Value::Table(table(below, base, mistakes)),
    };
    Some(Tree { value, span })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_nan_and_an_overflow_are_refused_and_the_rest_stays() {
        let text = "{ a = nan, b = [1.0, -inf], c = 1e999, d = 2.0 }";
        let mut mistakes = Vec::new();
        let tree = value(text, 7, &mut mistakes).flatten().unwrap();
        let place = |one: &Diagnostic| one.span.clone().map(|span| &text[span.start - 7..span.end - 7]).unwrap();
        let places: Vec<&str> = mistakes.iter().map(place).collect();
        assert_eq!(places, ["nan", "-inf", "1e999"]);
        assert_eq!(tree.value.to_json(), serde_json::json!({ "b": [1.0], "d": 2.0 }));
    }
}
