//! The loop unrolled: one cell for each stage and round, and the cells whose results each of them takes.

use crate::{
    diag::{Diagnostic, Span},
    pipeline::{
        limits::{MAX_CONNECTIONS, MAX_NODES},
        resolve::resolved::{Input, Pipeline, Reference, Stage},
        syntax::reference::RoundSelector,
    },
    stage::{Arity, Port},
};

/// The index of a cell.
pub(super) type CellId = usize;

/// A stage in one round, at all points of the matrix.
#[derive(Debug)]
pub(super) struct Cell {
    /// Index into [`Pipeline::stages`].
    pub(super) stage: usize,
    pub(super) round: Option<u32>,
    /// Every port of the kind, in its order.
    pub(super) inputs: Vec<CellInput>,
}

/// A port and the cells connected to it.
#[derive(Debug)]
pub(super) struct CellInput {
    pub(super) port: &'static Port,
    pub(super) upstream: Vec<Upstream>,
}

/// A cell whose results another cell takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Upstream {
    pub(super) cell: CellId,
    /// From all points of the matrix.
    pub(super) gathers: bool,
}

impl Cell {
    /// All cells whose results it takes.
    pub(super) fn upstream(&self) -> impl Iterator<Item = Upstream> {
        self.inputs.iter().flat_map(|input| input.upstream.iter().copied())
    }

    fn of_port(&self, port: &Port) -> &[Upstream] {
        self.inputs.iter().find(|input| input.port.name == port.name).map_or(&[], |input| &input.upstream)
    }
}

/// Where the cells of each stage lie: those of one stage follow each other.
struct Places<'a> {
    stages: &'a [Stage],
    rounds: u32,
    starts: Vec<CellId>,
}

impl Places<'_> {
    fn cell(&self, stage: usize, round: u32) -> Option<CellId> {
        let from = self.stages[stage].from?;
        (from..self.rounds).contains(&round).then(|| self.starts[stage] + (round - from) as usize)
    }

    /// The cells that a reference means in a stage's `round`. Cells that do not exist are left out.
    fn cells(&self, reference: &Reference, round: Option<u32>) -> Vec<CellId> {
        let stage = reference.stage;
        let Some(from) = self.stages[stage].from else { return vec![self.starts[stage]] };
        let one = |round: Option<u32>| round.and_then(|round| self.cell(stage, round)).into_iter().collect();
        match reference.rounds {
            RoundSelector::Same => one(round),
            RoundSelector::Previous => one(round.and_then(|round| round.checked_sub(1))),
            RoundSelector::SoFar => {
                round.map_or_else(Vec::new, |round| self.range(stage, from..round.saturating_add(1)))
            }
            RoundSelector::Last => one(self.rounds.checked_sub(1)),
            RoundSelector::All => self.range(stage, from..self.rounds),
            // A stage in the loop takes nothing from later rounds.
            RoundSelector::Round(wanted) => {
                one(Some(wanted).filter(|wanted| round.is_none_or(|round| *wanted <= round)))
            }
        }
    }

    fn range(&self, stage: usize, rounds: std::ops::Range<u32>) -> Vec<CellId> {
        rounds.filter_map(|round| self.cell(stage, round)).collect()
    }
}

/// Unrolls the loop; `None` where the pipeline is too large.
pub(super) fn cells(pipeline: &Pipeline, mistakes: &mut Vec<Diagnostic>) -> Option<Vec<Cell>> {
    let rounds = pipeline.rounds();
    let mut starts = Vec::new();
    let mut count = 0_usize;
    for stage in &pipeline.stages {
        starts.push(count);
        count += stage.from.map_or(1, |from| rounds.saturating_sub(from) as usize);
        if count > MAX_NODES {
            mistakes.push(too_large(count, "nodes", MAX_NODES, pipeline));
            return None;
        }
    }
    let places = Places { stages: &pipeline.stages, rounds, starts };
    let mut cells = Vec::with_capacity(count);
    let mut connections = 0;
    for (at, stage) in pipeline.stages.iter().enumerate() {
        let rounds: Vec<Option<u32>> = match stage.from {
            None => vec![None],
            Some(from) => (from..rounds).map(Some).collect(),
        };
        let first = cells.len();
        for round in rounds {
            let cell = Cell { stage: at, round, inputs: inputs_of(stage, round, &places) };
            connections += cell.upstream().count();
            if connections > MAX_CONNECTIONS {
                mistakes.push(too_large(connections, "connections", MAX_CONNECTIONS, pipeline));
                return None;
            }
            cells.push(cell);
        }
        check_counts(stage, &cells[first..], mistakes);
    }
    Some(cells)
}

/// The refusal of a pipeline that is too large to be unrolled.
pub(super) fn too_large(count: usize, what: &str, limit: usize, pipeline: &Pipeline) -> Diagnostic {
    let shown = if count == usize::MAX { "more than can be counted".to_owned() } else { format!("at least {count}") };
    let message = format!("the pipeline has too many {what}: {shown}, where {limit} are allowed");
    let longest = pipeline.axes.iter().max_by_key(|axis| axis.values.len());
    let longest = longest.filter(|axis| axis.values.len() > pipeline.rounds() as usize);
    match (longest, &pipeline.rounds) {
        (Some(axis), _) => Diagnostic::at(axis.span.clone(), message)
            .label(format!("has {} values", axis.values.len()))
            .help("give the axes of the matrix fewer values"),
        (None, Some(rounds)) => Diagnostic::at(rounds.span.clone(), message).help("lower `rounds`"),
        (None, None) => Diagnostic::general(message),
    }
}

fn inputs_of(stage: &Stage, round: Option<u32>, places: &Places<'_>) -> Vec<CellInput> {
    let of_port = |port: &'static Port| {
        let input = stage.inputs.iter().find(|input| input.port.name == port.name && !input.broken);
        let references = input.map_or(&[][..], |input| &input.references);
        let upstream = references.iter().flat_map(|reference| {
            let cells = places.cells(reference, round).into_iter();
            cells.map(|cell| Upstream { cell, gathers: reference.gathers })
        });
        CellInput { port, upstream: upstream.collect() }
    };
    stage.ports().iter().map(of_port).collect()
}

/// Every port gets as many results as it takes, in every round, and none twice.
fn check_counts(stage: &Stage, cells: &[Cell], mistakes: &mut Vec<Diagnostic>) {
    for input in stage.inputs.iter().filter(|input| !input.broken) {
        let fits = |cell: &Cell| match (input.port.arity, cell.of_port(input.port).len()) {
            (Arity::One, count) => count == 1,
            (Arity::Optional, count) => count <= 1,
            (Arity::Many, count) => count > 0,
        };
        if let Some(at) = cells.iter().position(|cell| !fits(cell)) {
            let later = cells[at..].iter().find(|cell| fits(cell)).and_then(|cell| cell.round);
            let count = cells[at].of_port(input.port).len();
            mistakes.push(wrong_count(input, count, cells[at].round, later));
            continue;
        }
        let repeats = |cell: &&Cell| {
            let mut ids: Vec<CellId> = cell.of_port(input.port).iter().map(|upstream| upstream.cell).collect();
            ids.sort_unstable();
            ids.windows(2).any(|pair| pair[0] == pair[1])
        };
        if let Some(cell) = cells.iter().find(repeats) {
            let message = format!("input `{}` gets the same result twice{}", input.port.name, in_round(cell.round));
            mistakes.push(Diagnostic::at(place(input), message).help("name every result once"));
        }
    }
}

/// A port that gets too many results or too few. `later` is the first round in which it gets as many as it takes.
fn wrong_count(input: &Input, count: usize, round: Option<u32>, later: Option<u32>) -> Diagnostic {
    let Port { name, artifact, arity, .. } = input.port;
    let takes = match arity {
        Arity::One => "one",
        Arity::Optional => "at most one",
        Arity::Many => "at least one",
    };
    let gets = if count == 0 { "none".to_owned() } else { count.to_string() };
    let message = format!("input `{name}` takes {takes} {artifact}, but gets {gets}{}", in_round(round));
    let mistake = Diagnostic::at(place(input), message);
    match (count, later) {
        (0, Some(later)) => mistake
            .label("does not exist in this round")
            .help(format!("begin the stage later: `loop = {{ from = {later} }}`")),
        (0, None) if round.is_some() => mistake.help("name a stage and a round that exist by then"),
        (0, None) => mistake.help("name a stage that gives it"),
        _ => mistake.help("name one result, such as `stage` or `stage@prev`"),
    }
}

fn in_round(round: Option<u32>) -> String {
    round.map_or_else(String::new, |round| format!(" in round {round}"))
}

/// The references of an input.
fn place(input: &Input) -> Span {
    match (input.references.first(), input.references.last()) {
        (Some(first), Some(last)) => first.span.start..last.span.end,
        _ => input.span.clone(),
    }
}
