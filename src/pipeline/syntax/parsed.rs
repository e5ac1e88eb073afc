//! The parsed pipeline: what a file says, before any name in it is looked up.

use std::collections::BTreeMap;

use super::{
    reference::ParsedReference,
    tree::{Key, Table, Tree},
};
use crate::{diag::Span, stage::Preset};

/// A pipeline file, changed by the command line.
#[derive(Debug)]
pub(crate) struct ParsedPipeline {
    pub(crate) name: String,
    pub(crate) description: String,
    pub(crate) labels: BTreeMap<String, String>,
    pub(crate) seed: u64,
    pub(crate) preset: Preset,
    pub(crate) task: ParsedTask,
    /// `None` where the file has no loop.
    pub(crate) rounds: Option<Rounds>,
    pub(crate) stages: Vec<ParsedStage>,
    pub(crate) axes: Vec<ParsedAxis>,
    /// The start of the file: the place of what the file lacks.
    pub(crate) start: Span,
}

/// `[task]`.
#[derive(Debug)]
pub(crate) enum ParsedTask {
    /// The file has none.
    Missing,
    /// It is not a table, which is reported.
    Unreadable,
    /// The table and where it stands.
    Written(TaskTable),
}

/// `[task]` as a table.
#[derive(Debug)]
pub(crate) struct TaskTable {
    pub(crate) table: Table,
    pub(crate) span: Span,
}

/// `rounds` of `[loop]`.
#[derive(Debug, Clone)]
pub(crate) struct Rounds {
    pub(crate) count: u32,
    pub(crate) span: Span,
}

/// One `[stages.name]`.
#[derive(Debug)]
pub(crate) struct ParsedStage {
    /// The name in the header.
    pub(crate) name: Key,
    pub(crate) kind: ParsedKind,
    /// The parameters written.
    pub(crate) params: Table,
    /// What differs in the stage's first round.
    pub(crate) first: Option<Table>,
    /// The first round of a stage in the loop.
    pub(crate) from: Option<u32>,
    /// True after a mistake in `loop`: rounds mean nothing then.
    pub(crate) loop_broken: bool,
    pub(crate) stream: Option<String>,
    pub(crate) inputs: Vec<ParsedInput>,
    /// True where `inputs` is not a table: an input may only seem to be left out then.
    pub(crate) inputs_broken: bool,
}

/// `kind` of a stage.
#[derive(Debug)]
pub(crate) enum ParsedKind {
    /// The stage has none.
    Missing,
    /// It is not a text, which is reported.
    Unreadable,
    /// The name of a kind.
    Named(Key),
}

/// One entry of `inputs`.
#[derive(Debug)]
pub(crate) struct ParsedInput {
    /// The port.
    pub(crate) port: Key,
    pub(crate) references: Vec<ParsedReference>,
    /// True after a mistake in a reference: nothing that follows from the mistake is reported.
    pub(crate) broken: bool,
}

/// One axis of the matrix. What it varies is not looked up yet.
#[derive(Debug)]
pub(crate) struct ParsedAxis {
    /// The path with dots: `seed`, `task.noise`, `represent.lambda.consistency`.
    pub(crate) name: String,
    pub(crate) span: Span,
    pub(crate) path: Vec<Key>,
    pub(crate) values: Vec<AxisValue>,
}

/// One value of an axis: a number, a text, or true or false.
#[derive(Debug)]
pub(crate) struct AxisValue {
    /// The value as node names show it.
    pub(crate) text: String,
    pub(crate) value: Tree,
}
