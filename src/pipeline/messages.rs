//! Sentences that several checks share.

use super::syntax::tree::{Key, Tree, Value};
use crate::diag::Diagnostic;

/// What a value is, such as ``the number `3` ``.
pub(crate) fn found(value: &Value) -> String {
    match value {
        Value::Text(text) => format!("the text `{text}`"),
        Value::Whole(number) => format!("the number `{number}`"),
        Value::Fraction(number) => format!("the fraction `{number:?}`"),
        Value::Boolean(boolean) => format!("the boolean `{boolean}`"),
        Value::Date(_) => "a date".to_owned(),
        Value::List(_) => "a list".to_owned(),
        Value::Table(_) => "a table".to_owned(),
    }
}

/// A value of the wrong type.
pub(crate) fn wrong_type(key: &str, expected: &str, tree: &Tree) -> Diagnostic {
    Diagnostic::at(tree.span.clone(), format!("`{key}` takes {expected}, but is {}", found(&tree.value)))
}

/// A path that goes on below a value.
pub(crate) fn holds_no_parameters(key: &Key) -> Diagnostic {
    Diagnostic::at(key.span.clone(), format!("`{}` holds no parameters", key.text))
}
