//! What a stage's parameters are at one point: preset, file, axes and `first` laid over each other, and checked.

use std::collections::BTreeMap;

use serde::Deserialize as _;
use serde_json::{Map, Value};
use toml::{
    Spanned,
    de::{DeTable, DeValue, ValueDeserializer},
};

use super::{
    draft::{Axis, Draft, StageDraft, Target, TaskTable},
    matrix::MAX_NODES,
    tree::{find, lay_json_over, lay_over, set, table_to_json, take_entry_at, to_json},
    wording::of_serde,
};
use crate::{
    diag::{Diagnostic, Span},
    env::{RefusedOption, Task},
    stage::{Kind, Preset, PresetOf, Refusal},
};

/// For each axis the index of its value, or `None` for what the file says without that axis.
pub(super) type Point = Vec<Option<usize>>;

/// Computes tasks and parameters once for each point at which they can differ.
pub(super) struct Settler<'a, 'i> {
    draft: &'a Draft<'i>,
    tasks: BTreeMap<Point, Option<Task>>,
    params: BTreeMap<(usize, bool, Point), Option<Value>>,
    pub(super) mistakes: Vec<Diagnostic>,
}

impl<'a, 'i> Settler<'a, 'i> {
    pub(super) fn new(draft: &'a Draft<'i>) -> Self {
        Self { draft, tasks: BTreeMap::new(), params: BTreeMap::new(), mistakes: Vec::new() }
    }

    /// Settles every stage at every point, for the mistakes.
    pub(super) fn settle_all(&mut self) {
        let draft = self.draft;
        _ = self.task(&self.base());
        for (at, stage) in draft.stages.iter().enumerate() {
            for point in points(&draft.axes, |axis| reaches_params(axis, at)) {
                self.params(at, false, &point);
                if stage.from.is_some() {
                    self.params(at, true, &point);
                }
            }
        }
    }

    /// The point of a node that stands outside of the matrix: an option of the task that only an axis gives takes its
    /// first value.
    pub(super) fn base(&self) -> Point {
        let base = |axis: &Axis<'i>| match &axis.target {
            Target::Task(path) if !self.draft.task.as_ref().is_some_and(|task| has(&task.table, path)) => Some(0),
            _ => None,
        };
        self.draft.axes.iter().map(base).collect()
    }

    /// The task at a point; `None` once its mistakes are reported.
    pub(super) fn task(&mut self, point: &[Option<usize>]) -> Option<Task> {
        let key = self.restricted(point, |axis| matches!(axis.target, Target::Task(_)));
        if let Some(known) = self.tasks.get(&key) {
            return known.clone();
        }
        let TaskTable { table, span: header } = self.draft.task.as_ref()?;
        let mut table = table.clone();
        for (axis, choice) in self.draft.axes.iter().zip(&key) {
            if let (Target::Task(path), Some(choice)) = (&axis.target, choice) {
                let set = set(&mut table, path, axis.values[*choice].value.clone());
                self.mistakes.extend(set.err().map(|key| no_table(&key)));
            }
        }
        let count = self.mistakes.len();
        refuse_unreadable(&mut table, header, "`[task]`", try_task, &mut self.mistakes);
        let value = Spanned::new(header.clone(), DeValue::Table(table.clone()));
        let task = Task::deserialize(ValueDeserializer::from(value)).ok();
        for RefusedOption { name, why, help } in task.iter().flat_map(Task::check) {
            let span = find(&table, &[name]).map_or_else(|| header.clone(), Spanned::span);
            let mistake = Diagnostic::at(span, format!("`{name}` {why}"));
            self.mistakes.push(Diagnostic { help, ..mistake });
        }
        let task = task.filter(|_| self.mistakes.len() == count);
        self.tasks.insert(key, task.clone());
        task
    }

    /// The parameters of a stage at a point; `None` where they cannot be known.
    pub(super) fn params(&mut self, at: usize, in_first: bool, point: &[Option<usize>]) -> Option<Value> {
        let key = (at, in_first, self.restricted(point, |axis| reaches_params(axis, at)));
        if let Some(known) = self.params.get(&key) {
            return known.clone();
        }
        let params = self.settle(at, in_first, &key.2);
        self.params.insert(key, params.clone());
        params
    }

    fn settle(&mut self, at: usize, in_first: bool, point: &[Option<usize>]) -> Option<Value> {
        let stage = &self.draft.stages[at];
        let kind = stage.kind?;
        let mut table = self.written(at, in_first, point);
        let owner = format!("`{}`", kind.name);
        let count = self.mistakes.len();
        refuse_unreadable(&mut table, &stage.span, &owner, kind.try_table, &mut self.mistakes);
        let task = self.task(point)?;
        let preset = self.preset(point);
        let given = table_to_json(&table);
        let defaults = (kind.preset)(&PresetOf { preset, task: &task, given: &given });
        match explicit(kind, defaults, given) {
            Ok(params) => {
                self.refuse_out_of_range(stage, kind, &params, &table, preset);
                self.refuse_without_inputs(stage, kind, &params);
                Some(params)
            }
            // What was wrong by itself is reported and gone, and may be missed now.
            Err(_) if self.mistakes.len() > count => None,
            Err(error) => {
                let message = format!("the parameters of `{}` do not go together: {error}", stage.name);
                self.mistakes.push(Diagnostic::at(stage.span.clone(), message));
                None
            }
        }
    }

    /// The table that the file, its axes and its `first` give.
    fn written(&mut self, at: usize, in_first: bool, point: &[Option<usize>]) -> DeTable<'i> {
        let stage = &self.draft.stages[at];
        let mut table = stage.params.clone();
        self.lay_axes(&mut table, at, false, point);
        if in_first {
            stage.first.iter().for_each(|first| lay_over(&mut table, first));
            self.lay_axes(&mut table, at, true, point);
        }
        table
    }

    fn lay_axes(&mut self, table: &mut DeTable<'i>, at: usize, first: bool, point: &[Option<usize>]) {
        for (axis, choice) in self.draft.axes.iter().zip(point) {
            if let (Target::Stage { stage, in_first, path }, Some(choice)) = (&axis.target, choice)
                && (*stage, *in_first) == (at, first)
            {
                let set = set(table, path, axis.values[*choice].value.clone());
                self.mistakes.extend(set.err().map(|key| no_table(&key)));
            }
        }
    }

    fn preset(&self, point: &[Option<usize>]) -> Preset {
        let chosen = self.draft.axes.iter().zip(point).find_map(|(axis, choice)| match axis.target {
            Target::Preset => choice.map(|choice| &axis.values[choice].value),
            _ => None,
        });
        chosen.and_then(|value| serde_json::from_value(to_json(value.get_ref())).ok()).unwrap_or(self.draft.preset)
    }

    fn refuse_out_of_range(
        &mut self,
        stage: &StageDraft<'_>,
        kind: &Kind,
        params: &Value,
        table: &DeTable<'_>,
        preset: Preset,
    ) {
        for Refusal { path, why } in (kind.check)(params).unwrap_or_default() {
            let parts: Vec<&str> = path.split('.').collect();
            let message = format!("`{path}` {why}");
            self.mistakes.push(match find(table, &parts) {
                Some(value) => Diagnostic::at(value.span(), message),
                None => {
                    let preset = if preset == Preset::Recipe { "recipe" } else { "paper" };
                    let label = format!("the value is from the preset `{preset}`");
                    let mistake = Diagnostic::at(stage.span.clone(), message).label(label);
                    mistake.help(format!("write `{path}` in `[stages.{}]`", stage.name))
                }
            });
        }
    }

    /// Inputs that may be left out, but not with these parameters.
    fn refuse_without_inputs(&mut self, stage: &StageDraft<'_>, kind: &Kind, params: &Value) {
        for port in (kind.needs)(params).unwrap_or_default() {
            if stage.inputs_broken || stage.inputs.iter().any(|input| input.port.name == *port) {
                continue;
            }
            let message = format!("stage `{}` lacks the input `{port}`, which its parameters need", stage.name);
            let mistake = Diagnostic::at(stage.span.clone(), message);
            self.mistakes.push(mistake.help(format!("write `inputs = {{ {port} = \"…\" }}`")));
        }
    }

    fn restricted(&self, point: &[Option<usize>], counts: impl Fn(&Axis<'i>) -> bool) -> Point {
        self.draft.axes.iter().zip(point).map(|(axis, choice)| choice.filter(|_| counts(axis))).collect()
    }
}

/// The parameters given laid over the defaults, written the one way that equal parameters have.
fn explicit(kind: &Kind, defaults: Value, given: Map<String, Value>) -> Result<Value, serde_json::Error> {
    let mut merged = defaults.clone();
    lay_json_over(&mut merged, Value::Object(given.clone()));
    (kind.canonical)(&merged).or_else(|error| {
        // Tables of a choice such as `{ uniform = { … } }` cannot be merged with another choice: they replace it.
        let mut replaced = defaults;
        let Value::Object(entries) = &mut replaced else { return Err(error) };
        entries.extend(given);
        (kind.canonical)(&replaced).map_err(|_| error)
    })
}

/// Whether an axis can change the parameters of a stage: presets may depend on the task.
pub(super) fn reaches_params(axis: &Axis<'_>, at: usize) -> bool {
    match &axis.target {
        Target::Seed => false,
        Target::Preset | Target::Task(_) => true,
        Target::Stage { stage, .. } => *stage == at,
    }
}

/// All points over the axes that count; none where they are too many, which is refused elsewhere.
pub(super) fn points<'i>(axes: &[Axis<'i>], counts: impl Fn(&Axis<'i>) -> bool) -> Vec<Point> {
    let mut points: Vec<Point> = vec![Vec::with_capacity(axes.len())];
    for axis in axes {
        let choices: Vec<Option<usize>> =
            if counts(axis) { (0..axis.values.len()).map(Some).collect() } else { vec![None] };
        if points.len().saturating_mul(choices.len()) > MAX_NODES {
            return Vec::new();
        }
        points = points
            .iter()
            .flat_map(|point| choices.iter().map(|choice| point.iter().copied().chain([*choice]).collect()))
            .collect();
    }
    points
}

/// Reads a table again and again, each time without the entry that was wrong, so that all mistakes are found.
fn refuse_unreadable<'i>(
    table: &mut DeTable<'i>,
    header: &Span,
    owner: &str,
    read: fn(ValueDeserializer<'_>) -> Result<(), toml::de::Error>,
    mistakes: &mut Vec<Diagnostic>,
) {
    let mut removed: Vec<String> = Vec::new();
    loop {
        let value = Spanned::new(header.clone(), DeValue::Table(table.clone()));
        let Err(error) = read(ValueDeserializer::from(value)) else { return };
        let missing = error.message().strip_prefix("missing field `").and_then(|rest| rest.split('`').next());
        if missing.is_some_and(|missing| removed.iter().any(|entry| entry.rsplit('.').next() == Some(missing))) {
            // It is missing only because it was wrong.
            return;
        }
        let span = error.span().unwrap_or_else(|| header.clone());
        let entry = take_entry_at(table, &span);
        mistakes.push(of_serde(error.message(), span, owner, entry.as_deref()));
        match entry {
            Some(entry) => removed.push(entry),
            None => return,
        }
    }
}

fn try_task(table: ValueDeserializer<'_>) -> Result<(), toml::de::Error> {
    Task::deserialize(table).map(|_| ())
}

pub(super) fn no_table(key: &super::tree::Key<'_>) -> Diagnostic {
    Diagnostic::at(key.span(), format!("`{}` holds no parameters", key.get_ref()))
}

fn has(table: &DeTable<'_>, path: &[super::tree::Key<'_>]) -> bool {
    let words: Vec<&str> = path.iter().map(|key| key.get_ref().as_ref()).collect();
    find(table, &words).is_some()
}
