//! TOML values with their places.

use serde_json::{Map, Number, Value as Json};

use crate::diag::Span;

/// A value and its place.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Tree {
    pub(crate) value: Value,
    pub(crate) span: Span,
}

/// A value. Numbers are finite.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Value {
    Text(String),
    Whole(i128),
    Fraction(f64),
    Boolean(bool),
    Date(String),
    List(Vec<Tree>),
    Table(Table),
}

/// A key and its place.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Key {
    pub(crate) text: String,
    pub(crate) span: Span,
}

/// The entries of a table in the order of the file. Every key occurs once.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Table(Vec<Entry>);

/// A key with its value.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Entry {
    pub(crate) key: Key,
    pub(crate) value: Tree,
}

impl Key {
    pub(crate) fn new(text: impl Into<String>, span: Span) -> Self {
        Self { text: text.into(), span }
    }
}

impl Value {
    pub(crate) fn as_text(&self) -> Option<&str> {
        match self {
            Self::Text(text) => Some(text),
            _ => None,
        }
    }

    pub(crate) fn as_table(&self) -> Option<&Table> {
        match self {
            Self::Table(table) => Some(table),
            _ => None,
        }
    }

    /// The value without its places.
    pub(crate) fn to_json(&self) -> Json {
        match self {
            Self::Text(text) | Self::Date(text) => Json::String(text.clone()),
            Self::Whole(number) => {
                let exact = i64::try_from(*number).map(Number::from);
                let exact = exact.or_else(|_| u64::try_from(*number).map(Number::from));
                exact.map_or_else(|_| Self::Fraction(*number as f64).to_json(), Json::Number)
            }
            Self::Fraction(number) => Number::from_f64(*number).map_or(Json::Null, Json::Number),
            Self::Boolean(boolean) => Json::Bool(*boolean),
            Self::List(items) => items.iter().map(|item| item.value.to_json()).collect(),
            Self::Table(table) => Json::Object(table.to_json()),
        }
    }

    /// How many lists and tables lie inside each other.
    pub(crate) fn depth(&self) -> usize {
        match self {
            Self::List(items) => 1 + items.iter().map(|item| item.value.depth()).max().unwrap_or(0),
            Self::Table(table) => 1 + table.iter().map(|entry| entry.value.value.depth()).max().unwrap_or(0),
            _ => 0,
        }
    }
}

impl Table {
    pub(crate) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    pub(crate) fn len(&self) -> usize {
        self.0.len()
    }

    pub(crate) fn iter(&self) -> impl Iterator<Item = &Entry> {
        self.0.iter()
    }

    pub(crate) fn keys(&self) -> impl Iterator<Item = &Key> {
        self.0.iter().map(|entry| &entry.key)
    }

    pub(crate) fn contains(&self, key: &str) -> bool {
        self.get(key).is_some()
    }

    pub(crate) fn get(&self, key: &str) -> Option<&Tree> {
        self.0.iter().find(|entry| entry.key.text == key).map(|entry| &entry.value)
    }

    pub(crate) fn get_mut(&mut self, key: &str) -> Option<&mut Tree> {
        self.0.iter_mut().find(|entry| entry.key.text == key).map(|entry| &mut entry.value)
    }

    /// Removes an entry and returns its value.
    pub(crate) fn take(&mut self, key: &str) -> Option<Tree> {
        self.take_entry(key).map(|entry| entry.value)
    }

    /// Removes an entry and returns it.
    pub(crate) fn take_entry(&mut self, key: &str) -> Option<Entry> {
        let at = self.0.iter().position(|entry| entry.key.text == key)?;
        Some(self.0.remove(at))
    }

    /// Keeps the entries for which `keep` is true.
    pub(crate) fn retain(&mut self, keep: impl FnMut(&mut Entry) -> bool) {
        self.0.retain_mut(keep);
    }

    /// Adds an entry, or replaces the entry of the same key together with the key's place.
    pub(crate) fn insert(&mut self, key: Key, value: Tree) {
        match self.0.iter_mut().find(|entry| entry.key.text == key.text) {
            Some(entry) => *entry = Entry { key, value },
            None => self.0.push(Entry { key, value }),
        }
    }

    /// Sets the value at a path and makes the tables on the way.
    ///
    /// # Errors
    /// The first part of the path whose value is not a table.
    pub(crate) fn set(&mut self, path: &[Key], value: Tree) -> Result<(), Key> {
        let [key, rest @ ..] = path else { return Ok(()) };
        if rest.is_empty() {
            self.insert(key.clone(), value);
            return Ok(());
        }
        if !self.contains(&key.text) {
            self.insert(key.clone(), Tree { value: Value::Table(Self::default()), span: key.span.clone() });
        }
        match self.get_mut(&key.text).map(|below| &mut below.value) {
            Some(Value::Table(below)) => below.set(rest, value),
            _ => Err(key.clone()),
        }
    }

    /// The value at a path, or the first value on the way that holds no others. A number leads into a list.
    pub(crate) fn find<'a>(&self, path: impl IntoIterator<Item = &'a str>) -> Option<&Tree> {
        let mut path = path.into_iter();
        let mut found = self.get(path.next()?)?;
        for part in path {
            found = match &found.value {
                Value::Table(below) => below.get(part)?,
                Value::List(items) => part.parse().ok().and_then(|at: usize| items.get(at)).unwrap_or(found),
                _ => return Some(found),
            };
        }
        Some(found)
    }

    /// Lays `over` on this table: tables are merged key by key, all other values are replaced.
    pub(crate) fn lay_over(&mut self, over: Self) {
        for Entry { key, value } in over.0 {
            match (self.get_mut(&key.text).map(|below| &mut below.value), value) {
                (Some(Value::Table(below)), Tree { value: Value::Table(above), .. }) => below.lay_over(above),
                (_, value) => self.insert(key, value),
            }
        }
    }

    /// The table without its places.
    pub(crate) fn to_json(&self) -> Map<String, Json> {
        self.0.iter().map(|entry| (entry.key.text.clone(), entry.value.value.to_json())).collect()
    }
}

impl FromIterator<Entry> for Table {
    fn from_iter<I: IntoIterator<Item = Entry>>(entries: I) -> Self {
        Self(entries.into_iter().collect())
    }
}

impl IntoIterator for Table {
    type Item = Entry;
    type IntoIter = std::vec::IntoIter<Entry>;

    fn into_iter(self) -> Self::IntoIter {
        self.0.into_iter()
    }
}
