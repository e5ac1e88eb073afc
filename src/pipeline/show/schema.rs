//! The JSON schema of pipeline files, for editors: they complete keys, show the help texts and underline mistakes.
//!
//! It is a little more lenient than carl-pipe itself, which alone knows how stages fit together.

use serde_json::{Map, Value, json};

use crate::{
    pipeline::resolve::task,
    stage::{Arity, Kind},
};

/// The schema of pipelines and suites.
pub fn schema(kinds: &[Kind]) -> Value {
    let mut definitions = Map::new();
    let names: Vec<&str> = kinds.iter().map(|kind| kind.name).collect();
    for kind in kinds {
        add_kind(kind, &mut definitions);
    }
    let of_kind = |name: &&str| {
        json!({ "if": { "properties": { "kind": { "const": name } }, "required": ["kind"] },
                "then": { "$ref": format!("#/$defs/{name}") } })
    };
    let about_stage = json!({
        "type": "object",
        "description": "a stage: its kind, its inputs and the parameters of the kind",
        "properties": { "kind": { "enum": names, "description": "what the stage does" } },
        "allOf": names.iter().map(of_kind).collect::<Value>(),
    });
    definitions.insert("stage".to_owned(), about_stage);
    definitions.insert("task".to_owned(), about_task());
    json!({
        "$schema": "https://json-schema.org/draft/2019-09/schema",
        "title": "a pipeline of carl-pipe",
        "type": "object",
        "additionalProperties": false,
        "required": ["schema", "name"],
        "properties": top_level(),
        "$defs": definitions,
    })
}

fn top_level() -> Value {
    let table = |about: &str| json!({ "type": "object", "description": about });
    let stage = json!({ "anyOf": [{ "$ref": "#/$defs/stage" }, { "const": false }] });
    json!({
        "schema": { "const": 1, "description": "the version of the format" },
        "name": { "type": "string", "description": "the name of the pipeline" },
        "description": { "type": "string", "description": "one line for people" },
        "extends": { "type": "string", "description": "a pipeline file that this one changes" },
        "labels": table("free texts for tables"),
        "seed": { "type": "integer", "minimum": 0, "description": "the seed of all random streams" },
        "preset": { "enum": ["recipe", "paper"], "description": "which defaults fill what the file leaves out" },
        "task": { "$ref": "#/$defs/task" },
        "loop": {
            "type": "object",
            "additionalProperties": false,
            "properties": { "rounds": { "type": "integer", "minimum": 1, "description": "how often the loop runs" } },
        },
        "stages": { "type": "object", "description": "the stages by name", "additionalProperties": stage },
        "matrix": table("values to run the pipeline with, by path"),
        "seeds": { "description": "the seeds of a suite's pipelines" },
        "set": table("values for all pipelines of a suite"),
        "suite": table("the pipelines of a suite by name"),
    })
}

/// `[task]` for editors. A file that builds on another one may leave `env` out.
fn about_task() -> Value {
    let mut schema = task::schema();
    if let Some(table) = schema.as_object_mut() {
        table.remove("required");
        table.insert("description".to_owned(), "the task and its options".into());
    }
    schema
}

/// Adds the schema of a stage of a kind. What it defines gets the kind's name before its own.
fn add_kind(kind: &Kind, definitions: &mut Map<String, Value>) {
    let mut schema = (kind.schema)().to_value();
    let prefix = format!("#/$defs/{}.", kind.name);
    adapt(&mut schema, &prefix);
    let Some(table) = schema.as_object_mut() else { return };
    if let Some(Value::Object(own)) = table.remove("$defs") {
        definitions.extend(own.into_iter().map(|(name, it)| (format!("{}.{name}", kind.name), it)));
    }
    for word in ["$schema", "title", "required"] {
        table.remove(word);
    }
    table.insert("description".to_owned(), kind.about.into());
    if let Some(properties) = table.get_mut("properties").and_then(Value::as_object_mut) {
        properties.extend(of_every_stage(kind));
    } else {
        table.insert("properties".to_owned(), Value::Object(of_every_stage(kind)));
    }
    definitions.insert(kind.name.to_owned(), schema);
}

/// The keys that a stage has beside the parameters of its kind.
fn of_every_stage(kind: &Kind) -> Map<String, Value> {
    let one = json!({ "type": "string", "description": "a stage, such as `represent` or `represent@prev`" });
    let reference = json!({ "anyOf": [one, { "type": "array", "items": one }] });
    let port = |port: &crate::stage::Port| {
        let arity = match port.arity {
            Arity::One => "one",
            Arity::Optional => "at most one",
            Arity::Many => "one or more",
        };
        let about = format!("{} {}: {}", arity, port.artifact, port.about.trim());
        (port.name.to_owned(), json!({ "description": about, "allOf": [reference] }))
    };
    let mut inputs = json!({ "type": "object", "description": "the stages whose results it takes" });
    if kind.declare.is_some() {
        inputs["additionalProperties"] = reference.clone();
    } else {
        inputs["properties"] = Value::Object(kind.ports.iter().map(port).collect());
        inputs["additionalProperties"] = false.into();
    }
    let of_loop = json!({
        "description": "whether the stage runs in every round, or from which round on",
        "anyOf": [{ "type": "boolean" }, { "type": "object", "properties": { "from": { "type": "integer", "minimum": 0 } } }],
    });
    let own = [
        ("kind", json!({ "const": kind.name })),
        ("inputs", inputs),
        ("loop", of_loop),
        ("first", json!({ "type": "object", "description": "parameters that differ in its first round" })),
        ("stream", json!({ "type": "string", "description": "a name for a random stream of its own" })),
    ];
    own.into_iter().map(|(name, schema)| (name.to_owned(), schema)).collect()
}

/// Moves references below `prefix`, lets a choice without required parameters be written as a word, and requires no
/// parameter: files that build on others, and sweeps, write parts of tables.
fn adapt(schema: &mut Value, prefix: &str) {
    match schema {
        Value::Array(items) => items.iter_mut().for_each(|item| adapt(item, prefix)),
        Value::Object(table) => {
            if let Some(Value::String(reference)) = table.get_mut("$ref")
                && let Some(name) = reference.strip_prefix("#/$defs/")
            {
                *reference = format!("{prefix}{name}");
            }
            if let Some(Value::Array(choices)) = table.remove("oneOf") {
                let words: Vec<Value> = choices.iter().filter_map(word).map(|word| json!({ "const": word })).collect();
                table.insert("anyOf".to_owned(), choices.into_iter().chain(words).collect());
            }
            table.values_mut().for_each(|below| adapt(below, prefix));
        }
        _ => {}
    }
}

/// The name of a choice that is a table of one entry.
fn word(choice: &Value) -> Option<String> {
    let properties = choice.get("properties")?.as_object().filter(|properties| properties.len() == 1)?;
    properties.keys().next().cloned()
}
