//! The task and the parameters of every stage, at every point of the matrix: preset, file, axes and `first` laid over
//! each other, and checked.

use std::collections::BTreeMap;

use serde_json::Value as Json;

use super::{
    defaults::explicit,
    points::{Point, points, reaches_params, restricted},
    resolved::{Pipeline, Stage, Target},
    schema::{self, Owner},
    task,
};
use crate::{
    diag::Diagnostic,
    env::{RefusedOption, Task, process::Unusable},
    pipeline::{
        messages::holds_no_parameters,
        syntax::{
            parsed::TaskTable,
            tree::{Key, Table},
        },
    },
    stage::{Kind, Outside, Preset, PresetOf, Refusal},
};

/// A stage's parameters in its first round or in the other rounds, at one point.
type ParamsAt = (usize, bool, Point);

/// Computes tasks and parameters, once for each point at which they can differ.
pub(crate) struct ParameterResolver<'a> {
    pipeline: &'a Pipeline,
    pub(crate) outside: &'a dyn Outside,
    task_schema: Json,
    /// By the name of the kind.
    schemas: BTreeMap<&'static str, Json>,
    tasks: BTreeMap<Point, Option<Task>>,
    params: BTreeMap<ParamsAt, Option<Json>>,
    /// The mistakes found so far.
    pub(crate) mistakes: Vec<Diagnostic>,
}

impl<'a> ParameterResolver<'a> {
    pub(crate) fn new(pipeline: &'a Pipeline, outside: &'a dyn Outside) -> Self {
        let kinds = pipeline.stages.iter().filter_map(|stage| stage.kind);
        Self {
            pipeline,
            outside,
            task_schema: task::schema(),
            schemas: kinds.map(|kind| (kind.name, (kind.schema)().to_value())).collect(),
            tasks: BTreeMap::new(),
            params: BTreeMap::new(),
            mistakes: Vec::new(),
        }
    }

    /// Resolves every stage at every point, in order to find all mistakes.
    pub(crate) fn resolve_all(&mut self) {
        let pipeline = self.pipeline;
        _ = self.task(&self.base());
        for (at, stage) in pipeline.stages.iter().enumerate() {
            for point in points(&pipeline.axes, |axis| reaches_params(axis, at)) {
                self.params(at, false, &point);
                if stage.from.is_some() {
                    self.params(at, true, &point);
                }
            }
        }
    }

    /// The point of a node that stands outside of the matrix. An option of the task that only an axis gives takes the
    /// first value of the axis.
    pub(crate) fn base(&self) -> Point {
        let task = self.pipeline.task.as_ref().map(|task| &task.table);
        let is_written = |path: &[_]| task.is_some_and(|table| table.find(words(path)).is_some());
        let axes = self.pipeline.axes.iter();
        axes.map(|axis| match &axis.target {
            Target::Task(path) if !is_written(path) => Some(0),
            _ => None,
        })
        .collect()
    }

    /// The task at a point; `None` where it has mistakes, which are reported.
    pub(crate) fn task(&mut self, point: &[Option<usize>]) -> Option<Task> {
        let key = restricted(&self.pipeline.axes, point, |axis| matches!(axis.target, Target::Task(_)));
        if let Some(known) = self.tasks.get(&key) {
            return known.clone();
        }
        let task = self.new_task(&key)?;
        self.tasks.insert(key, task.clone());
        task
    }

    /// `None` where the pipeline has no task at all.
    fn new_task(&mut self, point: &[Option<usize>]) -> Option<Option<Task>> {
        let TaskTable { table, span: header } = self.pipeline.task.as_ref()?;
        let mut table = table.clone();
        self.lay_axes(&mut table, point, |target| match target {
            Target::Task(path) => Some(path),
            _ => None,
        });
        let count = self.mistakes.len();
        schema::check(&mut table, &self.task_schema, Owner { name: "`[task]`", header }, &mut self.mistakes);
        let task: Option<Task> = serde_json::from_value(Json::Object(table.to_json())).ok();
        for RefusedOption { name, why, help } in task.iter().flat_map(Task::check) {
            let span = table.get(name).map_or(header, |value| &value.span);
            let mistake = Diagnostic::at(span.clone(), format!("`{name}` {why}"));
            self.mistakes.push(Diagnostic { help, ..mistake });
        }
        let task = task.filter(|_| self.mistakes.len() == count).and_then(|task| {
            let looked = task.look(self.pipeline.programs.as_deref());
            let report = |Unusable { key, why }: Unusable| {
                let span = table.get(key).map_or(header, |value| &value.span);
                self.mistakes.push(Diagnostic::at(span.clone(), format!("`{key}`: {why}")));
            };
            looked.map_err(report).ok()
        });
        if let Some((name, why)) = task.as_ref().and_then(|task| Some((task.name(), task.spec().mistake()?))) {
            let span = table.get("env").map_or(header, |value| &value.span);
            let help = Some("the `spec` of the task says so; change it in the task's own file".to_owned());
            let mistake = Diagnostic::at(span.clone(), format!("the task `{name}` cannot run: {why}"));
            self.mistakes.push(Diagnostic { help, ..mistake });
        }
        Some(task.filter(|_| self.mistakes.len() == count))
    }

    /// The parameters of a stage at a point; `None` where they have mistakes, which are reported.
    pub(crate) fn params(&mut self, at: usize, in_first: bool, point: &[Option<usize>]) -> Option<Json> {
        let key = (at, in_first, restricted(&self.pipeline.axes, point, |axis| reaches_params(axis, at)));
        if let Some(known) = self.params.get(&key) {
            return known.clone();
        }
        let params = self.new_params(at, in_first, &key.2);
        self.params.insert(key, params.clone());
        params
    }

    fn new_params(&mut self, at: usize, in_first: bool, point: &[Option<usize>]) -> Option<Json> {
        let stage = &self.pipeline.stages[at];
        let kind = stage.kind?;
        let mut table = self.written(at, in_first, point);
        let count = self.mistakes.len();
        let owner = format!("`{}`", kind.name);
        let owner = Owner { name: &owner, header: &stage.span };
        schema::check(&mut table, &self.schemas[kind.name], owner, &mut self.mistakes);
        let task = self.task(point)?;
        let preset = self.preset(point);
        let given = table.to_json();
        let defaults = (kind.preset)(&PresetOf { preset, task: &task, given: &given });
        match explicit(kind, &self.schemas[kind.name], defaults, given) {
            Ok(params) => {
                let count = self.mistakes.len();
                let refusals = (kind.check)(&params, &task).unwrap_or_default();
                self.refuse(refusals, stage, &table, preset);
                self.refuse_without_inputs(stage, kind, &params);
                self.refuse_other_declaration(stage, kind, &params, &table, preset);
                if self.mistakes.len() > count {
                    return Some(params);
                }
                let (params, refusals) = (kind.complete)(params, self.outside).ok()?;
                self.refuse(refusals, stage, &table, preset);
                Some(params)
            }
            // A mistake that is reported above was taken out of the table, and may be missed now.
            Err(_) if self.mistakes.len() > count => None,
            Err(error) => {
                let message = format!("the parameters of `{}` do not go together: {error}", stage.name);
                self.mistakes.push(Diagnostic::at(stage.span.clone(), message));
                None
            }
        }
    }

    /// The table that the file, its axes and its `first` give.
    fn written(&mut self, at: usize, in_first: bool, point: &[Option<usize>]) -> Table {
        let stage = &self.pipeline.stages[at];
        let mut table = stage.params.clone();
        self.lay_stage_axes(&mut table, at, false, point);
        if in_first {
            stage.first.iter().for_each(|first| table.lay_over(first.clone()));
            self.lay_stage_axes(&mut table, at, true, point);
        }
        table
    }

    fn lay_stage_axes(&mut self, table: &mut Table, at: usize, first: bool, point: &[Option<usize>]) {
        self.lay_axes(table, point, |target| match target {
            Target::Stage { stage, in_first, path } if (*stage, *in_first) == (at, first) => Some(path),
            _ => None,
        });
    }

    /// Sets the values of a point's axes, at the paths that `path_of` finds in their targets.
    fn lay_axes(&mut self, table: &mut Table, point: &[Option<usize>], path_of: impl Fn(&Target) -> Option<&Vec<Key>>) {
        for (axis, choice) in self.pipeline.axes.iter().zip(point) {
            if let (Some(path), Some(choice)) = (path_of(&axis.target), choice) {
                let set = table.set(path, axis.values[*choice].value.clone());
                self.mistakes.extend(set.err().map(|key| holds_no_parameters(&key)));
            }
        }
    }

    fn preset(&self, point: &[Option<usize>]) -> Preset {
        let chosen = self.pipeline.axes.iter().zip(point).find_map(|(axis, choice)| match axis.target {
            Target::Preset => choice.map(|choice| &axis.values[choice].value),
            _ => None,
        });
        let chosen = chosen.and_then(|tree| serde_json::from_value(tree.value.to_json()).ok());
        chosen.unwrap_or(self.pipeline.preset)
    }

    /// Reports refusals at the places of the values that they refuse.
    fn refuse(&mut self, refusals: Vec<Refusal>, stage: &Stage, table: &Table, preset: Preset) {
        for Refusal { path, why, help } in refusals {
            let message = format!("`{path}` {why}");
            self.mistakes.push(match table.find(path.split('.')) {
                Some(value) => Diagnostic { help, ..Diagnostic::at(value.span.clone(), message) },
                None => {
                    let preset = if preset == Preset::Recipe { "recipe" } else { "paper" };
                    let label = format!("the value is from the preset `{preset}`");
                    let mistake = Diagnostic::at(stage.span.clone(), message).label(label);
                    mistake.help(format!("write `{path}` in `[stages.{}]`", stage.name))
                }
            });
        }
    }

    /// Refuses parameters that do not fit the inputs of a stage that declares its own, or that declare another output than
    /// those written in the stage's table.
    fn refuse_other_declaration(&mut self, stage: &Stage, kind: &Kind, params: &Json, table: &Table, preset: Preset) {
        let Some(declare) = kind.declare.filter(|_| !stage.inputs_broken) else { return };
        let inputs: Vec<&str> = stage.inputs.iter().map(|input| input.port.name).collect();
        let declared = declare(params, &inputs);
        self.refuse(declared.refusals, stage, table, preset);
        if declared.output != kind.output {
            let message = format!("`{}` gives {} here, but {} otherwise", stage.name, declared.output, kind.output);
            let mistake = Diagnostic::at(stage.span.clone(), message);
            self.mistakes.push(mistake.help("the type of an output cannot vary; write two stages"));
        }
    }

    /// Refuses a stage whose parameters need an optional input that it has not.
    fn refuse_without_inputs(&mut self, stage: &Stage, kind: &Kind, params: &Json) {
        for port in (kind.needs)(params).unwrap_or_default() {
            if stage.inputs_broken || stage.inputs.iter().any(|input| input.port.name == *port) {
                continue;
            }
            let message = format!("stage `{}` lacks the input `{port}`, which its parameters need", stage.name);
            let mistake = Diagnostic::at(stage.span.clone(), message);
            self.mistakes.push(mistake.help(format!("write `inputs = {{ {port} = \"…\" }}`")));
        }
    }
}

/// The parts of a path as words.
fn words(path: &[Key]) -> impl Iterator<Item = &str> {
    path.iter().map(|key| key.text.as_str())
}
