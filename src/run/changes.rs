//! What differs between two keys, in words.

use serde_json::{Map, Value};

/// One difference between two keys.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Change {
    /// The part of the key that differs: `lambda.consistency`, `task.noise`, `seed`, `input model`.
    pub path: String,
    /// The value before; null if there was none.
    pub old: Value,
    /// The value now; null if there is none.
    pub new: Value,
}

impl std::fmt::Display for Change {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if self.path.starts_with("input ") {
            return match (self.old.is_null(), self.new.is_null()) {
                (true, _) => write!(f, "{} is new", self.path),
                (_, true) => write!(f, "{} is gone", self.path),
                _ => write!(f, "{} has other content", self.path),
            };
        }
        write!(f, "{} {} -> {}", self.path, word(&self.old), word(&self.new))
    }
}

fn word(value: &Value) -> String {
    match value {
        Value::Null => "(none)".to_owned(),
        Value::String(text) => text.clone(),
        // People write `7`, not `7.0`.
        Value::Number(number) if number.is_f64() => number.as_f64().unwrap_or_default().to_string(),
        other => other.to_string(),
    }
}

/// What changed from one key to another. The parameters of the node come first.
pub fn between(old: &Value, new: &Value) -> Vec<Change> {
    let mut found = Vec::new();
    for (part, prefix) in [("kind", "kind"), ("version", "version"), ("params", ""), ("task", "task"), ("stream", "")] {
        compare(prefix, &old[part], &new[part], &mut found);
    }
    let none = Map::new();
    let inputs = |key: &'_ Value| key["inputs"].as_object().unwrap_or(&none).clone();
    let (old_inputs, new_inputs) = (inputs(old), inputs(new));
    for port in old_inputs.keys().chain(new_inputs.keys().filter(|port| !old_inputs.contains_key(*port))) {
        let (old, new) = (&old["inputs"][port], &new["inputs"][port]);
        if old != new {
            found.push(Change { path: format!("input {port}"), old: old.clone(), new: new.clone() });
        }
    }
    compare("platform", &old["platform"], &new["platform"], &mut found);
    found
}

fn compare(path: &str, old: &Value, new: &Value, found: &mut Vec<Change>) {
    if let (Value::Object(before), Value::Object(after)) = (old, new) {
        for name in before.keys().chain(after.keys().filter(|name| !before.contains_key(*name))) {
            let path = if path.is_empty() { name.clone() } else { format!("{path}.{name}") };
            compare(&path, &old[name], &new[name], found);
        }
    } else if old != new {
        found.push(Change { path: path.to_owned(), old: old.clone(), new: new.clone() });
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_change_names_the_path_and_both_values() {
        let old = json!({"kind": "train_lce", "params": {"lambda": {"consistency": 7.0}}, "inputs": {"a": ["b3:1"]}});
        let new = json!({"kind": "train_lce", "params": {"lambda": {"consistency": 11.0}}, "inputs": {"a": ["b3:2"]}});
        let text: Vec<_> = between(&old, &new).iter().map(ToString::to_string).collect();
        assert_eq!(text, ["lambda.consistency 7 -> 11", "input a has other content"]);
        assert!(between(&old, &old).is_empty());
    }
}
