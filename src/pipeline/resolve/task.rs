//! The JSON schema of `[task]`.

use serde_json::{Map, Value as Json, json};

use crate::env::{OptionValue, process, registry};

/// The keys that the tasks know, and the type of each. An option of another task is refused later, by the task.
pub(crate) fn schema() -> Json {
    let names: Vec<&str> = registry().iter().map(|kind| kind.name).collect();
    let mut properties = Map::new();
    properties.insert("env".to_owned(), json!({ "enum": names }));
    for option in registry().iter().flat_map(|kind| kind.options) {
        let schema = match option.default {
            OptionValue::Number(_) => json!({ "type": "number" }),
            OptionValue::Count(_) => json!({ "type": "integer", "minimum": 0 }),
        };
        properties.entry(option.name).or_insert(schema);
    }
    properties.extend(process::fields().map(|(name, schema)| (name.to_owned(), schema)));
    json!({ "type": "object", "additionalProperties": false, "required": ["env"], "properties": properties })
}
