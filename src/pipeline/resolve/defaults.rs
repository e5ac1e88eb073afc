//! Parameters with all defaults written out.

use serde_json::{Map, Value as Json};

use super::{choices::Choices, types::resolved};
use crate::stage::Kind;

/// The parameters given, laid over the defaults and written the one way that equal parameters have.
pub(crate) fn explicit(
    kind: &Kind,
    schema: &Json,
    defaults: Json,
    given: Map<String, Json>,
) -> serde_json::Result<Json> {
    let mut params = defaults;
    lay_over(&mut params, Json::Object(given), schema, schema);
    (kind.canonical)(&params)
}

/// Lays a value over a default: tables are merged, all else is replaced. So is a table that makes another choice.
fn lay_over(under: &mut Json, over: Json, schema: &Json, root: &Json) {
    let schema = resolved(schema, root);
    let choices = Choices::of(schema, root);
    if let Some(choices) = &choices
        && choices.made(under) != choices.made(&over)
    {
        *under = over;
        return;
    }
    let made = choices.as_ref().and_then(|choices| choices.made(under)).map(str::to_owned);
    match (under, over) {
        (Json::Object(under), Json::Object(over)) => {
            for (key, value) in over {
                match under.get_mut(&key) {
                    Some(under) => {
                        lay_over(under, value, below(schema, choices.as_ref(), made.as_deref(), &key), root);
                    }
                    None => _ = under.insert(key, value),
                }
            }
        }
        (under, over) => *under = over,
    }
}

/// The schema of an entry of a table, which is `null` where the entry is unknown.
fn below<'a>(schema: &'a Json, choices: Option<&Choices<'a>>, made: Option<&str>, name: &str) -> &'a Json {
    let property = |schema: &'a Json| schema.get("properties")?.get(name);
    let found = match (choices, made) {
        (None, _) => property(schema),
        (Some(choices), Some(made)) if choices.tag.is_some() => choices.tables.get(made).copied().and_then(property),
        (Some(choices), Some(_)) => choices.tables.get(name).copied(),
        (Some(choices), None) => choices.others.iter().copied().find_map(property),
    };
    found.unwrap_or(&Json::Null)
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn laid(under: Json, over: Json) -> Json {
        let size = json!({ "type": "object", "properties": { "size": {}, "share": {} } });
        let schema = json!({ "properties": {
            "weights": { "$ref": "#/$defs/Weights" },
            "network": { "oneOf": [
                { "const": "plain" },
                { "properties": { "patches": size }, "required": ["patches"] },
                { "properties": { "blocks": size }, "required": ["blocks"] },
            ] },
        }, "$defs": { "Weights": { "properties": { "one": {}, "two": {} } } } });
        let mut params = under;
        lay_over(&mut params, over, &schema, &schema);
        params
    }

    #[test]
    fn tables_are_merged_and_another_choice_replaces_the_default() {
        let under = json!({ "weights": { "one": 1, "two": 2 }, "network": { "patches": { "size": 8, "share": 0.5 } } });
        let both = laid(under.clone(), json!({ "weights": { "two": 3 }, "network": { "patches": { "size": 4 } } }));
        assert_eq!(both["weights"], json!({ "one": 1, "two": 3 }));
        assert_eq!(both["network"], json!({ "patches": { "size": 4, "share": 0.5 } }));
        let other = laid(under.clone(), json!({ "weights": { "one": 9 }, "network": { "blocks": { "size": 4 } } }));
        assert_eq!(other["weights"], json!({ "one": 9, "two": 2 }), "the other tables keep their defaults");
        assert_eq!(other["network"], json!({ "blocks": { "size": 4 } }));
        assert_eq!(laid(under, json!({ "network": "plain" }))["network"], "plain");
    }
}
