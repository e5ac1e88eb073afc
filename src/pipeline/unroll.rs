//! The loop unrolled: one cell for each stage and round, and which cells each of them takes from.

use super::{
    draft::{Draft, InputDraft, Reference, StageDraft, Which},
    matrix::MAX_NODES,
};
use crate::{
    diag::Diagnostic,
    stage::{Arity, Port},
};

/// More connections than any pipeline needs; they would fill the memory.
const MAX_CONNECTIONS: usize = 10_000_000;

/// The index of a cell.
pub(super) type CellId = usize;

/// A stage in one round, at all points of the matrix.
#[derive(Debug)]
pub(super) struct Cell {
    pub(super) stage: usize,
    pub(super) round: Option<u32>,
    /// Every port of the kind, in its order.
    pub(super) inputs: Vec<(&'static Port, Vec<Giver>)>,
}

/// A cell that another takes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Giver {
    pub(super) cell: CellId,
    /// From all points of the matrix.
    pub(super) gathers: bool,
}

impl Cell {
    /// Whether the stage's `first` applies.
    pub(super) fn is_first(&self, stage: &StageDraft<'_>) -> bool {
        self.round.is_some() && self.round == stage.from
    }

    /// All cells it takes from.
    pub(super) fn givers(&self) -> impl Iterator<Item = Giver> {
        self.inputs.iter().flat_map(|(_, givers)| givers.iter().copied())
    }
}

/// Where the cells of each stage lie: those of one stage follow each other.
struct Layout<'a> {
    stages: &'a [StageDraft<'a>],
    rounds: u32,
    starts: Vec<CellId>,
}

impl Layout<'_> {
    fn cell(&self, stage: usize, round: u32) -> Option<CellId> {
        let from = self.stages[stage].from?;
        (from..self.rounds).contains(&round).then(|| self.starts[stage] + (round - from) as usize)
    }

    /// The cells a reference means for a taker in `round`; those that do not exist are left out.
    fn resolve(&self, reference: &Reference, round: Option<u32>) -> Vec<CellId> {
        let stage = reference.stage;
        let Some(from) = self.stages[stage].from else { return vec![self.starts[stage]] };
        let one = |round: Option<u32>| round.and_then(|round| self.cell(stage, round)).into_iter().collect();
        match reference.which {
            Which::Same => one(round),
            Which::Previous => one(round.and_then(|round| round.checked_sub(1))),
            Which::SoFar => round.map_or_else(Vec::new, |round| self.span(stage, from..round.saturating_add(1))),
            Which::Last => one(self.rounds.checked_sub(1)),
            Which::All => self.span(stage, from..self.rounds),
            // A stage in the loop sees no later round.
            Which::Round(wanted) => one(Some(wanted).filter(|wanted| round.is_none_or(|round| *wanted <= round))),
        }
    }

    fn span(&self, stage: usize, rounds: std::ops::Range<u32>) -> Vec<CellId> {
        rounds.filter_map(|round| self.cell(stage, round)).collect()
    }
}

/// Unrolls the loop; `None` where the pipeline is too large to.
pub(super) fn cells(draft: &Draft<'_>, mistakes: &mut Vec<Diagnostic>) -> Option<Vec<Cell>> {
    let mut starts = Vec::new();
    let mut count = 0_usize;
    for stage in &draft.stages {
        starts.push(count);
        count += stage.from.map_or(1, |from| draft.rounds.saturating_sub(from) as usize);
        if count > MAX_NODES {
            mistakes.push(too_large(count, "nodes", draft));
            return None;
        }
    }
    let layout = Layout { stages: &draft.stages, rounds: draft.rounds, starts };
    let mut cells = Vec::with_capacity(count);
    let mut connections = 0;
    for (at, stage) in draft.stages.iter().enumerate() {
        let rounds: Vec<Option<u32>> = match stage.from {
            None => vec![None],
            Some(from) => (from..draft.rounds).map(Some).collect(),
        };
        let first = cells.len();
        for round in rounds {
            let inputs = inputs_of(stage, round, &layout);
            connections += inputs.iter().map(|(_, givers)| givers.len()).sum::<usize>();
            if connections > MAX_CONNECTIONS {
                mistakes.push(too_large(connections, "connections", draft));
                return None;
            }
            cells.push(Cell { stage: at, round, inputs });
        }
        check_counts(stage, &cells[first..], mistakes);
    }
    Some(cells)
}

/// A pipeline of so many parts is refused before it is unrolled.
pub(super) fn too_large(count: usize, what: &str, draft: &Draft<'_>) -> Diagnostic {
    let shown = if count == usize::MAX { "more than can be counted".to_owned() } else { format!("at least {count}") };
    let limit = if what == "nodes" { MAX_NODES } else { MAX_CONNECTIONS };
    let message = format!("the pipeline has too many {what}: {shown}, where {limit} are allowed");
    let longest = draft.axes.iter().max_by_key(|axis| axis.values.len());
    let longest = longest.filter(|axis| axis.values.len() > draft.rounds as usize);
    match (longest, &draft.rounds_span) {
        (Some(axis), _) => Diagnostic::at(axis.span.clone(), message)
            .label(format!("has {} values", axis.values.len()))
            .help("give the axes of the matrix fewer values"),
        (None, Some(span)) => Diagnostic::at(span.clone(), message).help("lower `rounds`"),
        (None, None) => Diagnostic::general(message),
    }
}

fn inputs_of(stage: &StageDraft<'_>, round: Option<u32>, layout: &Layout<'_>) -> Vec<(&'static Port, Vec<Giver>)> {
    let ports = stage.kind.map_or(&[][..], |kind| kind.ports);
    let of_port = |port: &'static Port| {
        let input = stage.inputs.iter().find(|input| input.port.name == port.name && !input.broken);
        let references = input.map_or(&[][..], |input| &input.references);
        let givers = references.iter().flat_map(|reference| {
            let cells = layout.resolve(reference, round).into_iter();
            cells.map(|cell| Giver { cell, gathers: reference.gathers })
        });
        (port, givers.collect())
    };
    ports.iter().map(of_port).collect()
}

/// Every port gets as many as it takes, in every round, and nothing twice.
fn check_counts(stage: &StageDraft<'_>, cells: &[Cell], mistakes: &mut Vec<Diagnostic>) {
    for input in stage.inputs.iter().filter(|input| !input.broken) {
        let given = |cell: &Cell| {
            let found = cell.inputs.iter().find(|(port, _)| port.name == input.port.name);
            found.map_or_else(Vec::new, |(_, givers)| givers.clone())
        };
        let fits = |cell: &Cell| match (input.port.arity, given(cell).len()) {
            (Arity::One, count) => count == 1,
            (Arity::Optional, count) => count <= 1,
            (Arity::Many, count) => count > 0,
        };
        if let Some(at) = cells.iter().position(|cell| !fits(cell)) {
            let later = cells[at..].iter().find(|cell| fits(cell)).and_then(|cell| cell.round);
            mistakes.push(wrong_count(input, given(&cells[at]).len(), cells[at].round, later));
            continue;
        }
        let repeats = |cell: &&Cell| {
            let mut ids: Vec<CellId> = given(cell).iter().map(|giver| giver.cell).collect();
            ids.sort_unstable();
            ids.windows(2).any(|pair| pair[0] == pair[1])
        };
        if let Some(cell) = cells.iter().find(repeats) {
            let message = format!("input `{}` gets the same result twice{}", input.port.name, in_round(cell.round));
            mistakes.push(Diagnostic::at(place(input), message).help("name every result once"));
        }
    }
}

fn wrong_count(input: &InputDraft, count: usize, round: Option<u32>, later: Option<u32>) -> Diagnostic {
    let (name, artifact) = (input.port.name, input.port.artifact);
    let takes = match input.port.arity {
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

fn place(input: &InputDraft) -> crate::diag::Span {
    match (input.references.first(), input.references.last()) {
        (Some(first), Some(last)) => first.span.start..last.span.end,
        _ => input.span.clone(),
    }
}
