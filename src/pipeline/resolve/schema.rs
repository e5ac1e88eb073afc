//! Compares a table with the JSON schema of the type that it is read into. Every unknown key, wrong type and unknown
//! choice is reported at its place, and taken out, so that the rest can be used. A choice whose parameters all have defaults
//! may be written as a word: `"uniform"` becomes `{ uniform = {} }`.

use serde_json::Value as Json;

use crate::{
    diag::{Diagnostic, Span, instead},
    pipeline::{
        messages::{found, wrong_type},
        resolve::{
            choices::{Choices, expected},
            types::{accepts, resolved},
        },
        syntax::tree::{Entry, Key, Table, Tree, Value},
    },
};

/// What owns a table: its name in messages, such as `` `train_lce` ``, and the place of its header.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Owner<'a> {
    pub(crate) name: &'a str,
    pub(crate) header: &'a Span,
}

/// Takes out of `table` what the schema refuses, and reports it.
pub(crate) fn check(table: &mut Table, schema: &Json, owner: Owner<'_>, mistakes: &mut Vec<Diagnostic>) {
    let mut walk = Walk { root: schema, owner: owner.name, mistakes };
    walk.table(table, resolved(schema, schema), "", owner.header);
}

/// One walk along a table and its schema.
struct Walk<'a> {
    root: &'a Json,
    owner: &'a str,
    mistakes: &'a mut Vec<Diagnostic>,
}

impl Walk<'_> {
    /// Checks the entries of a table. `path` is empty for the owner's own table.
    fn table(&mut self, table: &mut Table, schema: &Json, path: &str, place: &Span) {
        let none = serde_json::Map::new();
        let properties = schema.get("properties").and_then(Json::as_object).unwrap_or(&none);
        let others = schema.get("additionalProperties");
        let required = schema.get("required").and_then(Json::as_array).into_iter().flatten().filter_map(Json::as_str);
        let missing: Vec<&str> = required.filter(|name| !table.contains(name)).collect();
        table.retain(|Entry { key, value }| {
            let below = if path.is_empty() { key.text.clone() } else { format!("{path}.{}", key.text) };
            match (properties.get(&key.text), others) {
                (Some(property), _) | (None, Some(property @ Json::Object(_))) => self.value(value, property, &below),
                (None, Some(Json::Bool(false))) => {
                    let message = format!("{} has no parameter `{}`", self.owner, key.text);
                    let mistake = Diagnostic::at(key.span.clone(), message).label("unknown");
                    let names = properties.keys().map(String::as_str);
                    self.mistakes.push(mistake.help(instead(&key.text, "parameters", names)));
                    false
                }
                _ => true,
            }
        });
        for name in missing {
            let owner = if path.is_empty() { self.owner.to_owned() } else { format!("`{path}`") };
            let mistake = Diagnostic::at(place.clone(), format!("{owner} needs `{name}`"));
            self.mistakes.push(mistake.help(format!("write `{name} = …`")));
        }
    }

    /// Checks a value, and says whether it can be used.
    fn value(&mut self, tree: &mut Tree, schema: &Json, path: &str) -> bool {
        let schema = resolved(schema, self.root);
        if let Some(choices) = Choices::of(schema, self.root) {
            return self.choice(tree, &choices, path);
        }
        if !accepts(schema, &tree.value) {
            self.mistakes.push(wrong_type(path, &expected(schema, self.root), tree));
            return false;
        }
        match &mut tree.value {
            Value::Table(table) => {
                self.table(table, schema, path, &tree.span);
                true
            }
            Value::List(items) => self.list(items, schema, path, &tree.span),
            _ => true,
        }
    }

    fn list(&mut self, items: &mut [Tree], schema: &Json, path: &str, place: &Span) -> bool {
        let bound = |word: &str| schema.get(word).and_then(Json::as_u64).map(|bound| bound as usize);
        let (low, high) = (bound("minItems").unwrap_or(0), bound("maxItems").unwrap_or(usize::MAX));
        if !(low..=high).contains(&items.len()) {
            let message = format!("`{path}` takes {low} values, but has {}", items.len());
            self.mistakes.push(Diagnostic::at(place.clone(), message));
            return false;
        }
        // One wrong item makes the list useless, but all items are looked at.
        let mut is_right = true;
        if let Some(schema) = schema.get("items") {
            for item in items {
                is_right &= self.value(item, schema, path);
            }
        }
        is_right
    }

    /// Checks a value that is one of several choices.
    fn choice(&mut self, tree: &mut Tree, choices: &Choices<'_>, path: &str) -> bool {
        let span = tree.span.clone();
        match &mut tree.value {
            Value::Text(word) if choices.has_word(word) => true,
            Value::Text(word) if choices.may_be_empty(word) => {
                let entry = Entry {
                    key: Key::new(word.clone(), span.clone()),
                    value: Tree { value: Value::Table(Table::default()), span },
                };
                tree.value = Value::Table(Table::from_iter([entry]));
                true
            }
            Value::Text(word) if choices.is_of_words() || choices.tables.contains_key(word.as_str()) => {
                let mistake = Diagnostic::at(span, format!("`{path}` cannot be `{word}`"));
                let help = if choices.tables.contains_key(word.as_str()) {
                    format!("write `{path} = {{ {word} = {{ … }} }}`")
                } else {
                    instead(word, "choices", choices.names())
                };
                self.mistakes.push(mistake.help(help));
                false
            }
            Value::Table(table) if choices.tag.is_some() => self.tagged(table, choices, path, &span),
            Value::Table(table) if !choices.tables.is_empty() => self.named(table, choices, path, &span),
            value => {
                let fitting = choices.others.iter().find(|schema| accepts(schema, value));
                match fitting {
                    Some(schema) => self.value(tree, schema, path),
                    None => {
                        self.mistakes.push(wrong_type(path, &choices.expected(self.root), tree));
                        false
                    }
                }
            }
        }
    }

    /// A choice that a key names: `{ uniform = { … } }`.
    fn named(&mut self, table: &mut Table, choices: &Choices<'_>, path: &str, place: &Span) -> bool {
        let mut is_right = true;
        if table.len() != 1 {
            let names: Vec<&str> = choices.names().collect();
            let message = format!("`{path}` takes one choice, but has {}", table.len());
            let place = table.keys().nth(1).map_or(place, |key| &key.span);
            self.mistakes.push(Diagnostic::at(place.clone(), message).help(format!("choices: {}", names.join(", "))));
            is_right = false;
        }
        table.retain(|Entry { key, value }| {
            let Some(schema) = choices.tables.get(key.text.as_str()) else {
                let message = format!("`{path}` cannot be `{}`", key.text);
                let help = if choices.has_word(&key.text) {
                    format!("write `{path} = \"{}\"`", key.text)
                } else {
                    instead(&key.text, "choices", choices.names())
                };
                self.mistakes.push(Diagnostic::at(key.span.clone(), message).help(help));
                return false;
            };
            self.value(value, schema, &format!("{path}.{}", key.text))
        });
        is_right && table.len() == 1
    }

    /// A choice that an entry of the table names: `{ kind = "uniform", … }`.
    fn tagged(&mut self, table: &mut Table, choices: &Choices<'_>, path: &str, place: &Span) -> bool {
        let tag = choices.tag.unwrap_or_default();
        let Some(written) = table.get(tag) else {
            let mistake = Diagnostic::at(place.clone(), format!("`{path}` needs `{tag}`"));
            self.mistakes.push(mistake.help(instead("", &format!("write `{tag} = …`; choices"), choices.names())));
            return false;
        };
        let Some(schema) = written.value.as_text().and_then(|word| choices.tables.get(word)) else {
            let word = written.value.as_text().map_or_else(|| found(&written.value), |word| format!("`{word}`"));
            let mistake = Diagnostic::at(written.span.clone(), format!("`{path}.{tag}` cannot be {word}"));
            let typed = written.value.as_text().unwrap_or_default();
            self.mistakes.push(mistake.help(instead(typed, "choices", choices.names())));
            return false;
        };
        self.table(table, schema, path, place);
        true
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::pipeline::syntax::document;

    /// The mistakes of a table as place, message and help, and what is left of the table.
    fn checked(text: &str) -> (Vec<String>, Json) {
        let size = json!({ "type": "object", "additionalProperties": false,
            "properties": { "size": { "type": "integer", "format": "uint64", "minimum": 0 } } });
        let mut sizes = size.clone();
        sizes["required"] = json!(["size"]);
        let schema = json!({ "type": "object", "additionalProperties": false, "properties": {
            "network": { "oneOf": [
                { "type": "string", "const": "plain" },
                { "type": "object", "additionalProperties": false, "properties": { "patches": size }, "required": ["patches"] },
                { "type": "object", "additionalProperties": false, "properties": { "blocks": sizes }, "required": ["blocks"] },
            ] },
            "noise": { "oneOf": [
                { "type": "object", "properties": { "kind": { "const": "none" } }, "additionalProperties": false },
                { "type": "object", "additionalProperties": false, "required": ["kind", "sigma"],
                  "properties": { "kind": { "const": "normal" }, "sigma": { "type": "number" } } },
            ] },
            "sizes": { "type": "array", "items": { "type": "integer", "minimum": 1 }, "minItems": 2, "maxItems": 2 },
            "step": { "type": ["number", "null"] },
        } });
        let mut mistakes = Vec::new();
        let mut table = document::document(text.as_bytes(), 0, &mut mistakes).unwrap();
        let owner = Owner { name: "`it`", header: &(0..0) };
        check(&mut table, &schema, owner, &mut mistakes);
        let said = |one: &Diagnostic| {
            let place = &text[one.span.clone().unwrap()];
            format!("{place}: {}; {}", one.message, one.help.as_deref().unwrap_or_default())
        };
        (mistakes.iter().map(said).collect(), Json::Object(table.to_json()))
    }

    #[test]
    fn a_table_that_fits_stays_as_it_is() {
        let text =
            "network = { patches = { size = 4 } }\nnoise = { kind = \"normal\", sigma = 1 }\nsizes = [3, 4]\nstep = 1";
        let (mistakes, left) = checked(text);
        assert_eq!(mistakes, [""; 0]);
        assert_eq!(left["noise"], json!({ "kind": "normal", "sigma": 1 }));
        assert_eq!(checked("network = \"plain\"").0, [""; 0]);
        assert_eq!(checked("network = \"patches\"").1, json!({ "network": { "patches": {} } }));
    }

    #[test]
    fn every_mistake_in_a_choice_has_its_place() {
        let (mistakes, left) =
            checked("network = { patches = { sise = 4, size = -1 } }\nstep = true\nsizes = [0, 1.5]");
        assert_eq!(
            mistakes,
            [
                "sise: `it` has no parameter `sise`; did you mean `size`?",
                "-1: `network.patches.size` takes a whole number from 0 up, but is the number `-1`; ",
                "true: `step` takes a number, but is the boolean `true`; ",
                "0: `sizes` takes a whole number from 1 up, but is the number `0`; ",
                "1.5: `sizes` takes a whole number from 1 up, but is the fraction `1.5`; ",
            ]
        );
        assert_eq!(left, json!({ "network": { "patches": {} } }));
    }

    #[test]
    fn an_unknown_choice_names_those_there_are() {
        let said = |text: &str| checked(text).0.join("\n");
        assert_eq!(said("network = \"plan\""), "\"plan\": `network` cannot be `plan`; did you mean `plain`?");
        assert_eq!(
            said("network = \"blocks\""),
            "\"blocks\": `network` cannot be `blocks`; write `network = { blocks = { … } }`"
        );
        assert_eq!(
            said("network = { patch = {} }"),
            "patch: `network` cannot be `patch`; choices: plain, blocks, patches"
        );
        assert_eq!(said("network = { plain = {} }"), "plain: `network` cannot be `plain`; write `network = \"plain\"`");
        assert_eq!(
            said("network = { patches = {}, blocks = { size = 1 } }"),
            "blocks: `network` takes one choice, but has 2; choices: plain, blocks, patches"
        );
        assert_eq!(
            said("network = 3"),
            "3: `network` takes one of `plain`, `blocks`, `patches`, but is the number `3`; "
        );
        assert_eq!(
            said("noise = { kind = \"norml\" }"),
            "\"norml\": `noise.kind` cannot be `norml`; did you mean `normal`?"
        );
        assert_eq!(
            said("noise = { kind = \"normal\" }"),
            "{ kind = \"normal\" }: `noise` needs `sigma`; write `sigma = …`"
        );
        assert_eq!(
            said("noise = { sigma = 1 }"),
            "{ sigma = 1 }: `noise` needs `kind`; write `kind = …`; choices: none, normal"
        );
    }
}
