//! The choices of a schema: what schemars writes for an enum or an optional type.

use std::collections::BTreeMap;

use serde_json::Value as Json;

use super::types::{resolved, type_in_words};

/// The choices between which a value picks.
#[derive(Debug, Default)]
pub(crate) struct Choices<'a> {
    /// Choices that are written as a word.
    words: Vec<&'a str>,
    /// Choices that are written as a table, by name: `{ name = { … } }`, or `{ tag = "name", … }` where there is a tag.
    pub(crate) tables: BTreeMap<&'a str, &'a Json>,
    /// The entry by which a table names its choice.
    pub(crate) tag: Option<&'a str>,
    /// Choices that are told by their type alone.
    pub(crate) others: Vec<&'a Json>,
}

impl<'a> Choices<'a> {
    /// The choices of a schema; `None` where it has none.
    pub(crate) fn of(schema: &'a Json, root: &'a Json) -> Option<Self> {
        let mut choices = Self::default();
        if let Some(words) = words_of(schema) {
            choices.words = words;
            return Some(choices);
        }
        for one in ["oneOf", "anyOf"].iter().find_map(|word| schema.get(word)?.as_array())? {
            choices.add(resolved(one, root), root);
        }
        Some(choices)
    }

    fn add(&mut self, schema: &'a Json, root: &'a Json) {
        if let Some(words) = words_of(schema) {
            self.words.extend(words);
        } else if let Some((tag, name)) = tag_of(schema) {
            self.tag = Some(tag);
            self.tables.insert(name, schema);
        } else if let Some((name, below)) = only_property(schema) {
            self.tables.insert(name, resolved(below, root));
        } else if let Some(inner) = Self::of(schema, root) {
            self.words.extend(inner.words);
            self.tables.extend(inner.tables);
            self.tag = self.tag.or(inner.tag);
            self.others.extend(inner.others);
        } else if schema.get("type").is_none_or(|word| word != "null") {
            self.others.push(schema);
        }
    }

    pub(crate) fn has_word(&self, word: &str) -> bool {
        self.words.contains(&word)
    }

    /// Whether a word names a choice whose parameters may all be left out.
    pub(crate) fn may_be_empty(&self, word: &str) -> bool {
        let required =
            |schema: &&Json| schema.get("required").and_then(Json::as_array).is_some_and(|it| !it.is_empty());
        self.tag.is_none() && self.tables.get(word).is_some_and(|schema| !required(schema))
    }

    /// Whether no text but the words fits.
    pub(crate) fn is_of_words(&self) -> bool {
        let takes_text = |schema: &&Json| schema.get("type").is_none_or(|word| word == "string");
        !self.words.is_empty() && !self.others.iter().any(takes_text)
    }

    /// The names of all choices.
    pub(crate) fn names(&self) -> impl Iterator<Item = &'a str> {
        self.words.iter().copied().chain(self.tables.keys().copied())
    }

    /// The choice that a value of this schema has made, where a table makes it.
    pub(crate) fn made<'v>(&self, value: &'v Json) -> Option<&'v str> {
        let table = value.as_object()?;
        let made = match self.tag {
            Some(tag) => table.get(tag)?.as_str(),
            None if table.len() == 1 => table.keys().next().map(String::as_str),
            None => None,
        };
        made.filter(|name| self.tables.contains_key(name))
    }

    /// The choices in words.
    pub(crate) fn expected(&self, root: &Json) -> String {
        let names: Vec<String> = self.names().map(|name| format!("`{name}`")).collect();
        let types = self.others.iter().map(|schema| expected(schema, root));
        let named = (!names.is_empty()).then(|| format!("one of {}", names.join(", ")));
        types.chain(named).collect::<Vec<_>>().join(" or ")
    }
}

/// What a schema takes, in words such as `a whole number from 0 up`.
pub(super) fn expected(schema: &Json, root: &Json) -> String {
    let schema = resolved(schema, root);
    match Choices::of(schema, root) {
        Some(choices) => choices.expected(root),
        None => type_in_words(schema),
    }
}

/// The words of a schema that takes only certain words.
fn words_of(schema: &Json) -> Option<Vec<&str>> {
    if let Some(word) = schema.get("const") {
        return word.as_str().map(|word| vec![word]);
    }
    schema.get("enum")?.as_array()?.iter().map(Json::as_str).collect()
}

/// The entry that names the choice of a table, and the name: `{ kind = "uniform", … }`.
fn tag_of(schema: &Json) -> Option<(&str, &str)> {
    let properties = schema.get("properties")?.as_object()?;
    properties.iter().find_map(|(name, property)| Some((name.as_str(), property.get("const")?.as_str()?)))
}

/// The one entry that a table must have and may have: `{ uniform = { … } }`.
fn only_property(schema: &Json) -> Option<(&str, &Json)> {
    let properties = schema.get("properties")?.as_object()?;
    let (name, below) = properties.iter().next().filter(|_| properties.len() == 1)?;
    let required = schema.get("required")?.as_array()?;
    (required.len() == 1 && required[0] == name.as_str()).then_some((name.as_str(), below))
}
