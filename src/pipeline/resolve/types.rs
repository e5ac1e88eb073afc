//! Types and ranges of JSON schemas.

use serde_json::Value as Json;

use crate::pipeline::syntax::tree::Value;

/// The schema that a `$ref` leads to, or the schema itself.
pub(crate) fn resolved<'a>(schema: &'a Json, root: &'a Json) -> &'a Json {
    let path = schema.get("$ref").and_then(Json::as_str).and_then(|reference| reference.strip_prefix('#'));
    path.and_then(|path| root.pointer(path)).unwrap_or(schema)
}

/// Whether a value has a type, and a whole number lies in the range, that the schema names.
pub(super) fn accepts(schema: &Json, value: &Value) -> bool {
    let is = |word: &str| match (word, value) {
        ("integer", Value::Whole(number)) => range(schema).contains(number),
        ("number", Value::Whole(_) | Value::Fraction(_))
        | ("boolean", Value::Boolean(_))
        | ("string", Value::Text(_) | Value::Date(_))
        | ("array", Value::List(_))
        | ("object", Value::Table(_)) => true,
        _ => false,
    };
    let words = type_words(schema);
    words.is_empty() || words.into_iter().any(is)
}

/// What a schema without choices takes, in words such as `a whole number from 0 up`.
pub(super) fn type_in_words(schema: &Json) -> String {
    let in_words = |word: &str| match word {
        "integer" => match (*range(schema).start(), schema.get("maximum").and_then(Json::as_i64)) {
            (low, Some(high)) => format!("a whole number from {low} to {high}"),
            (low, None) if low >= 0 => format!("a whole number from {low} up"),
            _ => "a whole number".to_owned(),
        },
        "number" => "a number".to_owned(),
        "boolean" => "true or false".to_owned(),
        "array" => "a list".to_owned(),
        "object" => "a table".to_owned(),
        _ => "a text".to_owned(),
    };
    let words = type_words(schema).into_iter().filter(|word| *word != "null");
    words.map(in_words).collect::<Vec<_>>().join(" or ")
}

/// The types that a schema names; none where every type fits.
fn type_words(schema: &Json) -> Vec<&str> {
    match schema.get("type") {
        Some(Json::String(word)) => vec![word],
        Some(Json::Array(words)) => words.iter().filter_map(Json::as_str).collect(),
        _ => Vec::new(),
    }
}

/// The whole numbers that fit a schema of type `integer`.
fn range(schema: &Json) -> std::ops::RangeInclusive<i128> {
    let (low, high) = match schema.get("format").and_then(Json::as_str) {
        Some("uint8") => (0, u8::MAX.into()),
        Some("uint16") => (0, u16::MAX.into()),
        Some("uint32") => (0, u32::MAX.into()),
        Some("uint64" | "uint") => (0, u64::MAX.into()),
        Some("int8") => (i8::MIN.into(), i8::MAX.into()),
        Some("int16") => (i16::MIN.into(), i16::MAX.into()),
        Some("int32") => (i32::MIN.into(), i32::MAX.into()),
        _ => (i64::MIN.into(), i64::MAX.into()),
    };
    let bound = |word: &str| schema.get(word).and_then(Json::as_i64).map(i128::from);
    bound("minimum").map_or(low, |bound| bound.max(low))..=bound("maximum").map_or(high, |bound| bound.min(high))
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_whole_number_lies_in_the_range_of_its_type() {
        let byte = json!({ "type": "integer", "format": "uint8", "minimum": 1, "maximum": 255 });
        let fits = |number| accepts(&byte, &Value::Whole(number));
        assert_eq!((fits(0), fits(1), fits(255), fits(256)), (false, true, true, false));
        assert_eq!(type_in_words(&byte), "a whole number from 1 to 255");
        assert!(!accepts(&byte, &Value::Fraction(1.0)));
        assert!(accepts(&json!({ "type": ["number", "null"] }), &Value::Whole(1)));
    }
}
