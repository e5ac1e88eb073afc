//! Kinds whose inputs and output each stage declares, such as `command`.

use std::{
    collections::BTreeMap,
    sync::{Mutex, PoisonError},
};

use serde_json::Value;

use super::{Arity, Kind, Port, Refusal};

/// What a port takes that takes the files of any artifact.
pub const ANY: &str = "any artifact";

/// What a stage declares of its kind.
#[derive(Debug, Default)]
pub struct Declared {
    /// See [`Kind::output`].
    pub output: &'static str,
    /// See [`Kind::readable_as`].
    pub readable_as: &'static [&'static str],
    /// See [`Kind::headline`].
    pub headline: Option<&'static str>,
    /// The parameters that do not fit the inputs.
    pub refusals: Vec<Refusal>,
}

/// The names of a kind, its output and its inputs.
type Shape = (&'static str, u32, &'static str, Vec<String>);

/// Each shape of each kind once. There are few: their number grows with the text of pipeline files.
static KNOWN: Mutex<BTreeMap<Shape, &'static Kind>> = Mutex::new(BTreeMap::new());

/// The kind that a stage declares. Its ports take any artifacts, in the order of their names.
pub(super) fn declared<'k, 'p>(kind: &'k Kind, params: &Value, inputs: impl IntoIterator<Item = &'p str>) -> &'k Kind {
    let Some(declare) = kind.declare else { return kind };
    let mut inputs: Vec<&str> = inputs.into_iter().collect();
    inputs.sort_unstable();
    let Declared { output, readable_as, headline, .. } = declare(params, &inputs);
    let names = inputs.into_iter().map(str::to_owned).collect();
    let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
    known.entry((kind.name, kind.version, output, names)).or_insert_with_key(|(.., names)| {
        let port = |name: &String| Port {
            name: name.clone().leak(),
            artifact: ANY,
            arity: Arity::Many,
            about: "files that the stage reads",
        };
        let ports = names.iter().map(port).collect::<Vec<_>>().leak();
        Box::leak(Box::new(Kind { output, readable_as, headline, ports, ..*kind }))
    })
}
