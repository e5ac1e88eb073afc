//! A pipeline file as written, its names resolved and its mistakes reported, before loop and matrix are unrolled.

use std::collections::BTreeMap;

use toml::de::DeTable;

use super::tree::{Key, Tree};
use crate::{
    diag::Span,
    stage::{Kind, Port, Preset},
};

/// The file as written.
#[derive(Debug)]
pub(super) struct Draft<'i> {
    pub(super) name: String,
    pub(super) description: String,
    pub(super) labels: BTreeMap<String, String>,
    pub(super) seed: u64,
    pub(super) preset: Preset,
    /// `None` where the file has none, which is reported.
    pub(super) task: Option<TaskTable<'i>>,
    /// Rounds of the loop, 0 where the file has no loop.
    pub(super) rounds: u32,
    pub(super) rounds_span: Option<Span>,
    pub(super) stages: Vec<StageDraft<'i>>,
    pub(super) axes: Vec<Axis<'i>>,
}

/// `[task]` and where it stands.
#[derive(Debug)]
pub(super) struct TaskTable<'i> {
    pub(super) table: DeTable<'i>,
    pub(super) span: Span,
}

/// One `[stages.name]`.
#[derive(Debug)]
pub(super) struct StageDraft<'i> {
    pub(super) name: String,
    /// The name in the header.
    pub(super) span: Span,
    /// `None` where the kind is unknown; the mistake is reported, and other checks go on without it.
    pub(super) kind: Option<&'static Kind>,
    /// The parameters written.
    pub(super) params: DeTable<'i>,
    /// What differs in the stage's first round.
    pub(super) first: Option<DeTable<'i>>,
    /// The first round of a stage in the loop.
    pub(super) from: Option<u32>,
    /// True once a mistake in `loop` is reported, so that rounds mean nothing.
    pub(super) loop_broken: bool,
    pub(super) stream: Option<String>,
    pub(super) inputs: Vec<InputDraft>,
    /// True once a mistake is reported after which an input may only seem to be left out.
    pub(super) inputs_broken: bool,
}

/// One entry of `inputs`.
#[derive(Debug)]
pub(super) struct InputDraft {
    pub(super) port: &'static Port,
    /// The port's name in the file.
    pub(super) span: Span,
    pub(super) references: Vec<Reference>,
    /// True once a mistake in it is reported, so that nothing that follows from it is.
    pub(super) broken: bool,
}

/// One reference to a stage's results, such as `evaluate@last[*]`.
#[derive(Debug, Clone)]
pub(super) struct Reference {
    /// Index into [`Draft::stages`].
    pub(super) stage: usize,
    pub(super) which: Which,
    /// `[*]`: from all points of the matrix.
    pub(super) gathers: bool,
    pub(super) span: Span,
    /// As written.
    pub(super) text: String,
}

/// The rounds that a reference means.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Which {
    /// `name`: this round, or the stage outside of the loop.
    Same,
    /// `name@prev`: the round before.
    Previous,
    /// `name@sofar`: this round and all before.
    SoFar,
    /// `name@last`: the last round of the loop.
    Last,
    /// `name@all`: all rounds.
    All,
    /// `name@3`.
    Round(u32),
}

/// One axis of the matrix.
#[derive(Debug)]
pub(super) struct Axis<'i> {
    /// As written: `seed`, `task.noise`, `represent.lambda.consistency`.
    pub(super) name: String,
    pub(super) span: Span,
    pub(super) target: Target<'i>,
    pub(super) values: Vec<AxisValue<'i>>,
}

/// What an axis varies.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Target<'i> {
    Seed,
    Preset,
    Task(Vec<Key<'i>>),
    Stage { stage: usize, in_first: bool, path: Vec<Key<'i>> },
}

impl Target<'_> {
    /// Whether it varies what all stages stand in, not one stage's parameters.
    pub(super) fn is_global(&self) -> bool {
        !matches!(self, Self::Stage { .. })
    }
}

/// One value of an axis.
#[derive(Debug)]
pub(super) struct AxisValue<'i> {
    /// As node names show it.
    pub(super) text: String,
    pub(super) value: Tree<'i>,
}
