//! The axes of the matrix, as written in `[matrix]` and by `--sweep`, with their values.

use std::collections::BTreeSet;

use super::{
    arguments::Changes,
    parsed::{AxisValue, ParsedAxis},
    path::{PathValue, flatten},
    tree::{Tree, Value},
    values,
};
use crate::{
    diag::{Diagnostic, Sources, Span},
    pipeline::{limits::MAX_NODES, messages::found},
};

const VALUES_HELP: &str = "write `[1, 2, 3]`, or `\"0..25\"` for the whole numbers below 25";

/// Reads `[matrix]`. An axis of the changes replaces the axis of the same name.
pub(crate) fn axes(
    matrix: Option<Tree>,
    changes: Changes,
    sources: &Sources,
    mistakes: &mut Vec<Diagnostic>,
) -> Vec<ParsedAxis> {
    let table = values::table(matrix, "matrix", mistakes).map(|(table, _)| table);
    let mut written = table.map(flatten).unwrap_or_default();
    written.retain(|axis| changes.sweeps.iter().all(|sweep| sweep.name() != axis.name()));
    written.extend(changes.sweeps);
    for path in changes.set.iter().filter(|path| written.iter().any(|axis| axis.name() == path.text)) {
        let mistake = Diagnostic::at(path.span.clone(), format!("`{}` is an axis of the matrix", path.text));
        mistakes.push(mistake.help(format!("write `--sweep {}=…` to replace the axis", path.text)));
    }
    let mut axes: Vec<ParsedAxis> = Vec::new();
    for one in written {
        let name = one.name();
        let span = one.keys.last().map_or(0..0, |key| key.span.clone());
        if axes.iter().any(|axis| axis.name == name) {
            let mistake = Diagnostic::at(span, format!("the axis `{name}` is given twice"));
            mistakes.push(mistake.help("join the values of both in one list"));
            continue;
        }
        let path = one.path(sources);
        axes.push(ParsedAxis { name, span, path, values: values_of(one, mistakes) });
    }
    axes
}

fn values_of(axis: PathValue, mistakes: &mut Vec<Diagnostic>) -> Vec<AxisValue> {
    let Tree { value, span } = axis.value;
    let items = match value {
        Value::Text(range) => range_values(&range, &span),
        Value::List(items) if items.is_empty() => Err("the axis has no values".to_owned()),
        Value::List(items) => Ok(items),
        other => Err(format!("an axis takes a list or a range, but is {}", found(&other))),
    };
    let items = items.unwrap_or_else(|message| {
        mistakes.push(Diagnostic::at(span, message).help(VALUES_HELP));
        Vec::new()
    });
    let mut seen = BTreeSet::new();
    let mut values = Vec::new();
    for value in items {
        match text_of(&value) {
            Ok(text) if seen.insert(text.strip_suffix(".0").unwrap_or(&text).to_owned()) => {
                values.push(AxisValue { text, value });
            }
            Ok(text) => {
                let mistake = Diagnostic::at(value.span, format!("the axis has the value `{text}` twice"));
                mistakes.push(mistake.help("leave one out"));
            }
            Err(mistake) => mistakes.push(mistake),
        }
    }
    values
}

/// The whole numbers of a half-open range such as `0..25`, all at the place of the range.
fn range_values(text: &str, span: &Span) -> Result<Vec<Tree>, String> {
    let (low, high) = text.split_once("..").ok_or_else(|| format!("`{text}` is no range"))?;
    let (Ok(low), Ok(high)) = (low.trim().parse::<i64>(), high.trim().parse::<i64>()) else {
        return Err(format!("`{text}` is no range of whole numbers"));
    };
    if low >= high {
        return Err(format!("the range `{text}` holds no number"));
    }
    if high.abs_diff(low) > MAX_NODES as u64 {
        return Err(format!("the range `{text}` holds more than {MAX_NODES} numbers"));
    }
    Ok((low..high).map(|number| Tree { value: Value::Whole(number.into()), span: span.clone() }).collect())
}

/// A value as node names show it. Node names are also file names and arguments.
fn text_of(value: &Tree) -> Result<String, Diagnostic> {
    let refuse = |message: String, help: &str| Err(Diagnostic::at(value.span.clone(), message).help(help));
    match &value.value {
        Value::Text(text) => {
            let plain = |byte: u8| byte.is_ascii_alphanumeric() || b"_.+-".contains(&byte);
            if text.is_empty() || !text.bytes().all(plain) {
                return refuse(format!("`{text}` cannot be a value of an axis"), "values become part of node names");
            }
            Ok(text.clone())
        }
        Value::Whole(_) | Value::Fraction(_) | Value::Boolean(_) => Ok(value.value.to_json().to_string()),
        other => {
            let message = format!("a value of an axis cannot be {}", found(other));
            refuse(message, "an axis lists numbers, texts, or true and false")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_range_is_half_open() {
        let numbers = |text| range_values(text, &(0..0)).map(|values| values.into_iter().map(|it| it.value).collect());
        assert_eq!(numbers("2..5"), Ok(vec![Value::Whole(2), Value::Whole(3), Value::Whole(4)]));
        for wrong in ["5..5", "5..2", "a..3", "..", "0..=3", "0..99999999999", "7"] {
            assert!(numbers(wrong).is_err(), "{wrong}");
        }
    }
}
