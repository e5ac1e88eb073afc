//! The parameters of a command, and what is found for them outside of the pipeline file.

use std::{collections::BTreeMap, path::Path};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::{
    outputs::Declaration,
    places::{Place, places},
};
use crate::{
    digest::Digest,
    stage::{NamedFile, Outside, PresetOf, Refusal, count},
};

/// The most attempts after the first one.
const MOST_RETRIES: u64 = 100;
/// The longest time limit in seconds: about a year.
const LONGEST: u64 = 366 * 24 * 3600;

#[derive(Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Params {
    /// The program and its arguments. These places are filled: `{inputs.NAME}` (a folder), `{outputs.NAME}` (a path to
    /// write to), `{params.NAME}`, `{seed}` and `{threads}`. `{{` is a brace.
    #[schemars(length(min = 1))]
    pub(super) argv: Vec<String>,
    /// What the program writes, by name: a file such as `model.bin`, or a folder such as `plots/`.
    pub(super) outputs: BTreeMap<String, String>,
    /// The type of the output. Any type but `files` has a fixed file that the program must write, and which is read and
    /// checked before it is published.
    #[serde(default)]
    pub(super) gives: Gives,
    /// Values for `{params.NAME}`. The program gets all of them as JSON in the variable `CARL_PARAMS`, too.
    #[serde(default)]
    pub(super) params: BTreeMap<String, Value>,
    /// The files of the program, from the folder of the pipeline file. The program finds copies in its working folder, and
    /// their content is part of the key.
    #[serde(default)]
    pub(super) files: Vec<String>,
    /// Python packages whose versions are part of the key, with that of Python. The first word of `argv` is asked.
    #[serde(default)]
    pub(super) packages: Vec<String>,
    /// Variables of the environment that the program gets: `NAME` passes one on, `NAME=value` sets one. The values are part
    /// of the key.
    #[serde(default)]
    pub(super) env: Vec<String>,
    /// Seconds after which the program is stopped; 0 for no limit.
    #[serde(default)]
    pub(super) timeout: u64,
    /// How often the program is started again after a failure.
    #[serde(default)]
    pub(super) retries: u64,
    /// What was found outside of the pipeline file.
    #[serde(default)]
    #[schemars(skip)]
    pub(super) found: Found,
}

/// The type of the output of a command.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(super) enum Gives {
    /// Files of any kind.
    #[default]
    Files,
    /// Pictures and actions.
    Transitions,
    /// Sequences of pictures and actions.
    Trajectories,
    /// The result of an evaluation.
    Evaluation,
    /// A latent model.
    LceModel,
    /// A policy.
    Agent,
}

/// What was found outside of the pipeline file when it was read.
#[derive(Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Found {
    /// The content of each file.
    pub(super) files: BTreeMap<String, Digest>,
    /// The version of each package.
    pub(super) packages: BTreeMap<String, String>,
    /// The value of each variable.
    pub(super) variables: BTreeMap<String, String>,
}

impl crate::stage::Params for Params {
    const NAMES_OUTSIDE: bool = true;

    fn preset(_: &PresetOf<'_>) -> Self {
        Self::default()
    }

    fn check(&self) -> Vec<Refusal> {
        let mut refusals = Vec::new();
        count(&mut refusals, "timeout", self.timeout, 0..=LONGEST);
        count(&mut refusals, "retries", self.retries, 0..=MOST_RETRIES);
        for (at, word) in self.argv.iter().enumerate() {
            let refuse = |why| Refusal::new(format!("argv.{at}"), why);
            refusals.extend(places(word).and_then(|places| self.all_known(&places)).err().map(refuse));
        }
        refusals.extend(Declaration::new(&self.outputs).err());
        let taken = |at: usize| self.files[..at].iter().any(|before| name_of(before) == name_of(&self.files[at]));
        for (at, path) in self.files.iter().enumerate() {
            let refuse = |why: &str| Refusal::new(format!("files.{at}"), why);
            match name_of(path) {
                None => refusals.push(refuse("is no path from the folder of the pipeline file")),
                Some(_) if taken(at) => refusals.push(refuse("has the name of a file before it")),
                Some(_) => {}
            }
        }
        for (at, entry) in self.env.iter().enumerate() {
            refusals.extend(refused_variable(entry).map(|why| Refusal::new(format!("env.{at}"), why)));
        }
        refusals
    }

    fn complete(&mut self, outside: &dyn Outside) -> Vec<Refusal> {
        let mut refusals = Vec::new();
        let mut found = Found::default();
        for (at, path) in self.files.iter().enumerate() {
            match outside.digest(path) {
                Ok(content) => _ = found.files.insert(path.clone(), content),
                Err(why) => refusals.push(Refusal::new(format!("files.{at}"), format!("cannot be read: {why}"))),
            }
        }
        if !self.packages.is_empty() {
            match outside.packages(&self.argv[0], &self.packages) {
                Ok(versions) => found.packages = versions,
                Err(why) => refusals.push(Refusal::new("packages", format!("cannot be looked up: {why}"))),
            }
        }
        for (at, entry) in self.env.iter().enumerate() {
            let (name, value) = match entry.split_once('=') {
                Some((name, value)) => (name, Some(value.to_owned())),
                None => (entry.as_str(), outside.variable(entry)),
            };
            match value {
                Some(value) => _ = found.variables.insert(name.to_owned(), value),
                None => {
                    let refusal = Refusal::new(format!("env.{at}"), "is not set here");
                    refusals.push(refusal.help(format!("write `\"{name}=value\"`, or set it")));
                }
            }
        }
        self.found = found;
        refusals
    }

    fn files(&self) -> Vec<NamedFile> {
        let files = self.found.files.iter();
        files.map(|(path, &content)| NamedFile { path: path.clone(), content }).collect()
    }
}

impl Params {
    /// Says which place of a word names an output or a parameter that the stage does not have.
    fn all_known(&self, places: &[Place<'_>]) -> Result<(), String> {
        for place in places {
            match place {
                Place::Output(name) if !self.outputs.contains_key(*name) => {
                    return Err(format!("names the output `{name}`, which `outputs` does not have"));
                }
                Place::Param(name) if !self.params.contains_key(*name) => {
                    return Err(format!("names the parameter `{name}`, which `params` does not have"));
                }
                _ => {}
            }
        }
        Ok(())
    }

    /// The words that name an input other than these.
    pub(super) fn without_input(&self, inputs: &[&str]) -> Vec<Refusal> {
        let unknown = |word: &str| {
            let places = places(word).unwrap_or_default();
            places.into_iter().find_map(|place| match place {
                Place::Input(name) if !inputs.contains(&name) => Some(name.to_owned()),
                _ => None,
            })
        };
        let refuse = |(at, name): (usize, String)| {
            Refusal::new(format!("argv.{at}"), format!("names the input `{name}`, which the stage does not have"))
                .help(format!("write `inputs = {{ {name} = \"…\" }}`"))
        };
        let words = self.argv.iter().enumerate();
        words.filter_map(|(at, word)| Some((at, unknown(word)?))).map(refuse).collect()
    }
}

/// The name of a program's file in the working folder: its path without the `../` that it begins with. `None` for a path
/// that has no name there.
pub(super) fn name_of(path: &str) -> Option<&Path> {
    let mut rest = Path::new(path);
    while let Ok(below) = rest.strip_prefix("..") {
        rest = below;
    }
    super::outputs::is_plain(rest).then_some(rest)
}

/// Why an entry of `env` cannot be used.
fn refused_variable(entry: &str) -> Option<String> {
    let name = entry.split('=').next().unwrap_or_default();
    let mut letters = name.bytes();
    let is_name = letters.next().is_some_and(|first| first.is_ascii_alphabetic() || first == b'_')
        && letters.all(|letter| letter.is_ascii_alphanumeric() || letter == b'_');
    if !is_name {
        return Some(format!("is no variable: `{name}` is no name"));
    }
    if name.starts_with("CARL_") {
        return Some("is a variable that carl-pipe sets itself".to_owned());
    }
    entry.contains('\0').then(|| "holds a zero byte".to_owned())
}
