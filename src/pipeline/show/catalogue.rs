//! The kinds that a pipeline can name, with their inputs and parameters: the output of `carl-pipe stages`.

use std::fmt::Write as _;

use serde_json::{Map, Value, json};

use super::wrap::wrap;
use crate::{
    env::Task,
    pipeline::resolve::{choices::Choices, types::resolved},
    stage::{Arity, Kind, Preset, PresetOf},
};

/// A parameter as its schema and the two presets describe it.
struct Parameter {
    path: String,
    type_: String,
    recipe: Value,
    paper: Value,
    about: String,
}

/// Every kind as text. Presets may depend on the task.
pub fn stages_text(kinds: &[Kind], task: &Task) -> String {
    let kinds: Vec<String> = kinds.iter().map(|kind| kind_text(kind, task)).collect();
    kinds.join("\n")
}

/// Every kind as JSON.
pub fn stages_json(kinds: &[Kind], task: &Task) -> Value {
    kinds.iter().map(|kind| kind_json(kind, task)).collect()
}

fn kind_text(kind: &Kind, task: &Task) -> String {
    let mut text = format!("{} -> {}\n{}\n", kind.name, kind.output, wrap(&format!("  {}", kind.about), 2));
    if !kind.ports.is_empty() {
        text.push_str("  inputs\n");
    }
    for port in kind.ports {
        let line = format!("    {}: {}{}", port.name, port.artifact, arity_text(port.arity));
        _ = writeln!(text, "{}", described(&line, port.about));
    }
    let parameters = parameters(kind, task);
    if !parameters.is_empty() {
        text.push_str("  parameters\n");
    }
    for parameter in parameters {
        let Parameter { path, type_, recipe, paper, about } = parameter;
        let mut line = format!("    {path}: {type_} = {}", shown(&recipe));
        if recipe != paper {
            line.push_str(&format!(" (paper: {})", shown(&paper)));
        }
        _ = writeln!(text, "{}", described(&wrap(&line, 8), &about));
    }
    text
}

/// A line with its description below it.
fn described(line: &str, about: &str) -> String {
    let about = about.split_whitespace().collect::<Vec<_>>().join(" ");
    if about.is_empty() { line.to_owned() } else { format!("{line}\n{}", wrap(&format!("        {about}"), 8)) }
}

fn arity_text(arity: Arity) -> &'static str {
    match arity {
        Arity::One => "",
        Arity::Optional => ", optional",
        Arity::Many => ", one or more",
    }
}

fn shown(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Null => "none".to_owned(),
        other => other.to_string(),
    }
}

fn kind_json(kind: &Kind, task: &Task) -> Value {
    let inputs = kind.ports.iter().map(|port| {
        let arity = match port.arity {
            Arity::One => "one",
            Arity::Optional => "optional",
            Arity::Many => "many",
        };
        json!({ "name": port.name, "artifact": port.artifact, "arity": arity, "about": port.about.trim() })
    });
    let parameters = parameters(kind, task).into_iter().map(|parameter| {
        let Parameter { path, type_, recipe, paper, about } = parameter;
        json!({ "path": path, "type": type_, "recipe": recipe, "paper": paper, "about": about })
    });
    json!({
        "kind": kind.name,
        "version": kind.version,
        "about": kind.about,
        "output": kind.output,
        "inputs": inputs.collect::<Vec<_>>(),
        "parameters": parameters.collect::<Vec<_>>(),
        "schema": (kind.schema)().as_value(),
    })
}

fn parameters(kind: &Kind, task: &Task) -> Vec<Parameter> {
    let given = Map::new();
    let of_preset = |preset| (kind.preset)(&PresetOf { preset, task, given: &given });
    let (recipe, paper) = (of_preset(Preset::Recipe), of_preset(Preset::Paper));
    let schema = (kind.schema)();
    let mut found = Vec::new();
    collect("", schema.as_value(), schema.as_value(), (&recipe, &paper), &mut found);
    found
}

/// The parameters of an object's schema. Parameters of tables in it have dotted paths.
fn collect(above: &str, schema: &Value, root: &Value, values: (&Value, &Value), found: &mut Vec<Parameter>) {
    let Some(properties) = schema.get("properties").and_then(Value::as_object) else { return };
    for (name, written) in properties {
        let path = if above.is_empty() { name.clone() } else { format!("{above}.{name}") };
        let property = resolved(written, root);
        let at = |value: &Value| value.get(name).cloned().unwrap_or(Value::Null);
        let (recipe, paper) = (at(values.0), at(values.1));
        if property.get("properties").is_some() {
            collect(&path, property, root, (&recipe, &paper), found);
            continue;
        }
        let choices = Choices::of(property, root);
        let about = [written, property].iter().find_map(|schema| schema.get("description")?.as_str());
        let about = about.unwrap_or_default().to_owned();
        let made = |value: &Value| match choices.as_ref().and_then(|choices| choices.made(value)) {
            Some(name) => name.into(),
            None => value.clone(),
        };
        let type_ = type_of(property, root);
        found.push(Parameter { path: path.clone(), type_, recipe: made(&recipe), paper: made(&paper), about });
        for (name, schema) in choices.iter().flat_map(|choices| &choices.tables) {
            let below = |value: &Value| value.get(name).cloned().unwrap_or_else(|| defaults(schema));
            collect(&format!("{path}.{name}"), schema, root, (&below(&recipe), &below(&paper)), found);
        }
    }
}

/// The defaults that the schema of a table names.
fn defaults(schema: &Value) -> Value {
    let properties = schema.get("properties").and_then(Value::as_object).into_iter().flatten();
    properties.filter_map(|(name, property)| Some((name.clone(), property.get("default")?.clone()))).collect()
}

fn type_of(schema: &Value, root: &Value) -> String {
    let schema = resolved(schema, root);
    if let Some(value) = schema.get("const") {
        return shown(value);
    }
    if let Some(values) = schema.get("enum").and_then(Value::as_array) {
        return values.iter().map(shown).collect::<Vec<_>>().join(" | ");
    }
    if let Some(choices) = Choices::of(schema, root) {
        let others = choices.others.iter().map(|schema| type_of(schema, root));
        return choices.names().map(str::to_owned).chain(others).collect::<Vec<_>>().join(" | ");
    }
    match schema.get("type") {
        Some(Value::String(word)) => word_of(word, schema, root),
        Some(Value::Array(words)) => {
            let words = words.iter().filter_map(Value::as_str).map(|word| word_of(word, schema, root));
            words.collect::<Vec<_>>().join(" | ")
        }
        _ => "value".to_owned(),
    }
}

fn word_of(word: &str, schema: &Value, root: &Value) -> String {
    match word {
        "integer" => "whole number".to_owned(),
        "boolean" => "true | false".to_owned(),
        "string" => "text".to_owned(),
        "null" => "none".to_owned(),
        "object" => "table".to_owned(),
        "array" => match schema.get("items") {
            Some(items) => format!("list of {}", type_of(items, root)),
            None => "list".to_owned(),
        },
        other => other.to_owned(),
    }
}
