//! The resolved pipeline: kinds, ports, stages and targets of axes stand in place of their names.

use std::{collections::BTreeMap, path::PathBuf};

use crate::{
    diag::Span,
    pipeline::syntax::{
        parsed::{AxisValue, Rounds, TaskTable},
        reference::RoundSelector,
        tree::{Key, Table},
    },
    stage::{Kind, Port, Preset},
};

/// A pipeline before loop and matrix are unrolled.
#[derive(Debug)]
pub(crate) struct Pipeline {
    pub(crate) name: String,
    pub(crate) description: String,
    pub(crate) labels: BTreeMap<String, String>,
    pub(crate) seed: u64,
    pub(crate) preset: Preset,
    /// `None` where the file has none, which is reported.
    pub(crate) task: Option<TaskTable>,
    /// The folder in which programs that the file names run, if it is known.
    pub(crate) programs: Option<PathBuf>,
    /// `None` where the file has no loop.
    pub(crate) rounds: Option<Rounds>,
    pub(crate) stages: Vec<Stage>,
    pub(crate) axes: Vec<Axis>,
}

impl Pipeline {
    /// Rounds of the loop; 0 without a loop.
    pub(crate) fn rounds(&self) -> u32 {
        self.rounds.as_ref().map_or(0, |rounds| rounds.count)
    }
}

/// A stage.
#[derive(Debug)]
pub(crate) struct Stage {
    pub(crate) name: String,
    /// The name in the header.
    pub(crate) span: Span,
    /// `None` where the kind is unknown, which is reported. The other checks go on without it.
    pub(crate) kind: Option<&'static Kind>,
    /// The parameters written.
    pub(crate) params: Table,
    /// What differs in the stage's first round.
    pub(crate) first: Option<Table>,
    /// The first round of a stage in the loop.
    pub(crate) from: Option<u32>,
    /// True after a mistake in `loop`: rounds mean nothing then.
    pub(crate) loop_broken: bool,
    pub(crate) stream: Option<String>,
    pub(crate) inputs: Vec<Input>,
    /// True after a mistake by which an input may only seem to be left out.
    pub(crate) inputs_broken: bool,
}

impl Stage {
    /// The ports of the kind.
    pub(crate) fn ports(&self) -> &'static [Port] {
        self.kind.map_or(&[], |kind| kind.ports)
    }

    /// Whether `first` applies in a round.
    pub(crate) fn is_first(&self, round: Option<u32>) -> bool {
        round.is_some() && round == self.from
    }
}

/// An input of a stage.
#[derive(Debug)]
pub(crate) struct Input {
    pub(crate) port: &'static Port,
    /// The port's name in the file.
    pub(crate) span: Span,
    pub(crate) references: Vec<Reference>,
    /// True after a mistake in a reference: nothing that follows from the mistake is reported.
    pub(crate) broken: bool,
}

/// A reference to results of a stage.
#[derive(Debug, Clone)]
pub(crate) struct Reference {
    /// Index into [`Pipeline::stages`].
    pub(crate) stage: usize,
    pub(crate) rounds: RoundSelector,
    /// `[*]`: from all points of the matrix.
    pub(crate) gathers: bool,
    pub(crate) span: Span,
    /// The reference as written.
    pub(crate) text: String,
}

/// An axis of the matrix.
#[derive(Debug)]
pub(crate) struct Axis {
    /// The path with dots.
    pub(crate) name: String,
    pub(crate) span: Span,
    pub(crate) target: Target,
    pub(crate) values: Vec<AxisValue>,
}

/// What an axis varies.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Target {
    Seed,
    Preset,
    Task(Vec<Key>),
    Stage { stage: usize, in_first: bool, path: Vec<Key> },
}

impl Target {
    /// Whether the axis varies what all stages depend on, rather than the parameters of one stage.
    pub(crate) fn is_global(&self) -> bool {
        !matches!(self, Self::Stage { .. })
    }
}
