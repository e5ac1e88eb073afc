//! Sizes that no machine can serve, and numbers that are none, are refused at their place before anything runs.

use std::panic::catch_unwind;

use crate::support::stages;
use carl_pipe::{
    pipeline::{Overrides, Source, load},
    stage,
};
use serde_json::{Value, json};

/// The dotted paths of all numbers in a table, and whether they are counts.
fn numbers(table: &Value, path: &str, found: &mut Vec<(String, bool)>) {
    match table {
        Value::Object(entries) => {
            for (name, value) in entries {
                let below = if path.is_empty() { name.clone() } else { format!("{path}.{name}") };
                numbers(value, &below, found);
            }
        }
        Value::Number(number) => found.push((path.to_owned(), number.is_u64())),
        _ => {}
    }
}

/// What a stage of this kind must say, as TOML.
fn needed(kind: &str) -> &'static str {
    match kind {
        "import_data" => "file = \"data.npz\"\n",
        "command" => "argv = [\"true\"]\noutputs = { made = \"made.bin\" }\n",
        _ => "",
    }
}

/// Every number that a pipeline file may set, by kind and path.
fn all_numbers() -> Vec<(&'static str, String, bool)> {
    let task = stages::planar();
    let mut all = Vec::new();
    for kind in stage::registry() {
        for given in [
            json!({}),
            json!({ "objective": { "value_guided": {} } }),
            json!({ "objective": { "pc3": {} } }),
            json!({ "networks": { "pooled_patches": {} } }),
            json!({ "region": { "biased": {} } }),
        ] {
            let known = (kind.schema)().to_value()["properties"].clone();
            let choice = given.as_object().and_then(|given| given.keys().next());
            if choice.is_some_and(|choice| known.get(choice).is_none()) {
                continue;
            }
            let mut written: Value = toml::from_str(needed(kind.name)).expect("TOML");
            written.as_object_mut().expect("a table").extend(given.as_object().expect("a table").clone());
            let mut params = (kind.canonical)(&written).expect("defaults");
            if params.get("slopes").is_some() {
                params["slopes"] = json!({ "exact": { "refit_steps": 0 } });
            }
            let mut found = Vec::new();
            numbers(&params, "", &mut found);
            all.extend(found.into_iter().map(|(path, is_count)| (kind.name, path, is_count)));
        }
    }
    all.sort();
    all.dedup();
    assert!(task.check().is_empty() && all.len() > 60, "{all:?}");
    all
}

/// The mistakes of a stage with one parameter set: message and the text at their place.
fn mistakes(kind: &str, path: &str, value: &str) -> Vec<(String, String)> {
    let stage = format!("[stages.it]\nkind = \"{kind}\"\n{}{path} = {value}\n", needed(kind));
    let text = format!("schema = 1\nname = \"it\"\n[task]\nenv = \"planar\"\n{stage}");
    let loaded = || load(&Source::new("p.toml", text.as_bytes()), &Overrides::default(), stage::registry());
    let loaded = catch_unwind(loaded).unwrap_or_else(|_| panic!("{kind}: {path} = {value} panics"));
    let Err(mistakes) = loaded else { return Vec::new() };
    let place = |span: Option<std::ops::Range<usize>>| span.map_or("", |span| &text[span]).to_owned();
    mistakes.list().iter().map(|one| (one.message.clone(), place(one.span.clone()))).collect()
}

fn is_refused_at_its_place(kind: &str, path: &str, value: &str) -> bool {
    mistakes(kind, path, value).iter().any(|(message, place)| place == value && message.contains('`'))
}

#[test]
fn a_count_beyond_all_sense_is_refused_at_its_place() {
    for (kind, path, _) in all_numbers().into_iter().filter(|(.., is_count)| *is_count) {
        // Some counts may be 0 or a thousand millions.
        _ = (is_refused_at_its_place(kind, &path, "0"), is_refused_at_its_place(kind, &path, "1_000_000_000"));
        for absurd in ["1_000_000_000_000", "18446744073709551615", "18446744073709551616", "-1", "1.5"] {
            assert!(is_refused_at_its_place(kind, &path, absurd), "{kind}: {path} = {absurd}");
        }
    }
}

#[test]
fn a_number_that_is_not_finite_or_negative_is_refused_at_its_place() {
    for (kind, path, _) in all_numbers() {
        for bad in ["nan", "inf", "-inf", "1e400", "-1e400", "-1.0"] {
            assert!(is_refused_at_its_place(kind, &path, bad), "{kind}: {path} = {bad}");
        }
    }
}

#[test]
fn parameters_that_together_ask_for_too_much_memory_are_refused_in_any_task() {
    for (env, kind, params, path) in [
        ("planar", "generate_data", json!({ "samples": 30_000_000 }), "samples"),
        ("three_pole", "collect", json!({ "samples": 3_000_000 }), "samples"),
        ("three_pole", "train_sac", json!({ "buffer": 1_000_000_000, "steps": 10_000_000 }), "buffer"),
    ] {
        let kind = stage::kind(kind).expect("a kind");
        let task = serde_json::from_value(json!({ "env": env })).expect("a task");
        let params = (kind.canonical)(&params).expect("parameters");
        let [refusal] = &(kind.check)(&params, &task).expect("parameters")[..] else { panic!("{}", kind.name) };
        assert_eq!(refusal.path, path);
        assert!(refusal.why.ends_with(" GiB; the most is 64.0 GiB"), "{}", refusal.why);
    }
    // Few steps never fill a large buffer.
    let kind = stage::kind("train_sac").expect("a kind");
    let params = (kind.canonical)(&json!({ "buffer": 1_000_000_000 })).expect("parameters");
    assert_eq!((kind.check)(&params, &stages::planar()).expect("parameters"), []);
}
