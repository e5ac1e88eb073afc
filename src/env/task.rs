//! The `[task]` table of a pipeline: which environment, and the options of its dynamics, all of them explicit.
//!
//! A table may name an option that belongs to another task. [`Task::check`] refuses it, since it would change nothing.

use std::path::Path;

use serde::{
    Deserialize, Deserializer, Serialize, Serializer,
    de::{DeserializeSeed, Error as _, MapAccess, Visitor},
    ser::{Error as _, SerializeMap as _},
};
use serde_json::{Map, Value};

use super::{
    DefaultsOf, NetworkSizes, Simulator, Spec, Start, System,
    process::{self, Program, Unusable},
    registry::{OptionValue, TaskKind, TaskOption, World, registry, task_kind},
    simulate,
};

/// The `[task]` table, with the defaults of the environment written out.
#[derive(Debug, Clone)]
pub struct Task {
    /// The kind of task, which the table calls `env`.
    pub kind: &'static TaskKind,
    /// The options of the kind in its order, and after them those that the kind does not have.
    options: Vec<(&'static str, OptionValue)>,
    /// The program of an environment in another process.
    program: Option<Box<Program>>,
}

impl PartialEq for Task {
    fn eq(&self, other: &Self) -> bool {
        let of_program = |task: &Self| task.program.as_ref().map(|program| program.in_key());
        self.name() == other.name() && self.options == other.options && of_program(self) == of_program(other)
    }
}

/// An option of the task that cannot be used.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RefusedOption {
    /// The name of the option.
    pub name: &'static str,
    /// A lower-case clause such as ``must be 0 or above, but is `-1` ``.
    pub why: String,
    /// The next step.
    pub help: Option<String>,
}

impl Task {
    /// The task as pipelines write it in `env`.
    pub fn name(&self) -> &'static str {
        self.kind.name
    }

    /// Starts a simulator of the task, whose options [`Task::check`] has accepted.
    ///
    /// # Errors
    /// Whatever keeps the simulator from starting.
    pub fn open(&self) -> anyhow::Result<Box<dyn Simulator>> {
        match self.kind.world {
            World::System(system) => Ok(simulate(system(self))),
            World::Simulator { open, .. } => open(self),
            World::Process => process::open(self.program()),
        }
    }

    /// The command and the options of its program; `None` where it has none.
    pub fn program_and_options(&self) -> Option<(&[String], &Map<String, Value>)> {
        self.program.as_ref().map(|program| (&program.command[..], &program.options))
    }

    /// The equations of the task; `None` where only a simulator knows them.
    pub fn system(&self) -> Option<Box<dyn System>> {
        match self.kind.world {
            World::System(system) => Some(system(self)),
            World::Simulator { .. } | World::Process => None,
        }
    }

    /// What is known of the task before it is simulated.
    pub fn spec(&self) -> Spec {
        match self.kind.world {
            World::System(system) => system(self).spec(),
            World::Simulator { spec, .. } => spec(self),
            World::Process => self.program().spec(),
        }
    }

    /// The program of a task in another process.
    fn program(&self) -> &Program {
        self.program.as_ref().expect("a task of the kind `process` has a program")
    }

    /// Looks at the program of a task in another process: its files, which lie below `folder`, its versions, and what it
    /// says of itself. Other tasks stay as they are.
    ///
    /// # Errors
    /// Why no environment can run.
    pub fn look(mut self, folder: Option<&Path>) -> Result<Self, Unusable> {
        if let Some(program) = self.program.take() {
            let why = "a program needs a pipeline file in a folder, where it can run".to_owned();
            let folder = folder.ok_or(Unusable { key: "command", why })?;
            self.program = Some(Box::new(program.look(folder)?));
        }
        Ok(self)
    }

    /// The same task with a log of its own: see [`Task::take_log`].
    #[must_use]
    pub fn with_own_log(&self) -> Self {
        let program = self.program.as_ref().map(|program| Box::new(program.with_own_log()));
        Self { program, ..self.clone() }
    }

    /// What its program wrote to standard error since the last call, line by line.
    pub fn take_log(&self) -> Vec<String> {
        self.program.as_ref().map(|program| program.log().take()).unwrap_or_default()
    }

    /// What keys hold of the task.
    pub fn in_key(&self) -> Map<String, Value> {
        let mut table = Map::from_iter([("env".to_owned(), Value::from(self.name()))]);
        let options = self.options.iter().map(|(name, value)| ((*name).to_owned(), serde_json::json!(value)));
        table.extend(options);
        table.extend(self.program.iter().flat_map(|program| program.in_key()));
        table
    }

    /// Mean %-goal of the best controller known from these starts, with the task's own goals and radius. None was measured
    /// for fixed starts.
    pub fn ceiling_of(&self, start: Start) -> Option<f64> {
        (self.kind.ceiling)(self, start).filter(|_| start != Start::Fixed)
    }

    /// Mean %-goal of online CARL in the paper's Table 1, if the table has this system.
    pub fn paper_online(&self) -> Option<f64> {
        (self.kind.paper_online)(self)
    }

    /// Widths of the networks that learn this task.
    pub fn networks(&self) -> NetworkSizes {
        (self.kind.networks)(self)
    }

    /// Parameters of a stage kind that differ from the kind's general preset, as a table that is laid over it.
    pub fn defaults(
        &self,
        stage: &str,
        preset: super::Preset,
        given: &serde_json::Map<String, serde_json::Value>,
    ) -> serde_json::Value {
        (self.kind.defaults)(&DefaultsOf { task: self, stage, preset, given })
    }

    /// The value of an option that is a real number.
    ///
    /// # Panics
    /// If the task has no such option.
    pub fn number(&self, name: &str) -> f64 {
        self.value(name).as_f64()
    }

    /// The value of an option that is a count.
    ///
    /// # Panics
    /// If the task has no such option.
    pub fn count(&self, name: &str) -> usize {
        self.value(name).as_f64() as usize
    }

    fn value(&self, name: &str) -> OptionValue {
        let found = self.options.iter().find(|(option, _)| *option == name);
        found.unwrap_or_else(|| panic!("the task `{}` has no option `{name}`", self.name())).1
    }

    /// Every option that the task does not have, or whose value is out of range.
    pub fn check(&self) -> Vec<RefusedOption> {
        let options = self.options.iter().filter_map(|(name, value)| self.refuse(name, value.as_f64()));
        let of_program = self.program.iter().flat_map(|program| program.refusals());
        options.chain(of_program.map(|(name, why)| RefusedOption { name, why, help: None })).collect()
    }

    fn refuse(&self, name: &'static str, value: f64) -> Option<RefusedOption> {
        let Some(option) = self.kind.options.iter().find(|option| option.name == name) else {
            let of_program = self.program.iter().flat_map(|_| process::fields()).map(|(name, _)| name);
            let known = self.kind.options.iter().map(|option| option.name).chain(of_program);
            let known: Vec<String> = known.map(|name| format!("`{name}`")).collect();
            let help = if known.is_empty() { "it has none".to_owned() } else { format!("it has {}", known.join(", ")) };
            return Some(RefusedOption { name, why: format!("is no option of `{}`", self.name()), help: Some(help) });
        };
        let why = || format!("must be {}, but is `{value}`", option.range_in_words());
        (!option.range.contains(&value)).then(|| RefusedOption { name, why: why(), help: None })
    }
}

impl Serialize for Task {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut table = serializer.serialize_map(None)?;
        table.serialize_entry("env", self.name())?;
        for (name, value) in &self.options {
            table.serialize_entry(name, value)?;
        }
        if let Some(program) = &self.program {
            let program = serde_json::to_value(program).map_err(S::Error::custom)?;
            for (name, value) in program.as_object().into_iter().flatten() {
                table.serialize_entry(name, value)?;
            }
        }
        table.end()
    }
}

impl<'de> Deserialize<'de> for Task {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_map(TaskVisitor)
    }
}

/// Reads the table. A mistake is reported where its key or value stands, so that messages show the place.
struct TaskVisitor;

impl<'de> Visitor<'de> for TaskVisitor {
    type Value = Task;

    fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("a map")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut table: A) -> Result<Task, A::Error> {
        let (mut kind, mut given, mut of_program) = (None, Vec::new(), Map::new());
        while let Some(key) = table.next_key_seed(KeySeed)? {
            match key {
                TaskKey::Env => kind = Some(table.next_value_seed(KindSeed)?),
                TaskKey::Option(option) => given.push((option.name, table.next_value_seed(ValueSeed(option))?)),
                TaskKey::Program(name) => _ = of_program.insert(name.to_owned(), table.next_value::<Value>()?),
            }
        }
        let kind: &'static TaskKind = kind.ok_or_else(|| A::Error::missing_field("env"))?;
        let program = if matches!(kind.world, World::Process) {
            Some(serde_json::from_value(Value::Object(of_program)).map_err(A::Error::custom)?)
        } else {
            // `check` refuses them as options of another task. Their values do not matter.
            let names = process::fields().into_iter().map(|(name, _)| name);
            given.extend(names.filter(|name| of_program.contains_key(*name)).map(|name| (name, OptionValue::Count(0))));
            None
        };
        let mut options: Vec<_> = kind.options.iter().map(|option| (option.name, option.default)).collect();
        for (name, value) in given {
            match options.iter_mut().find(|(known, _)| *known == name) {
                Some(option) => option.1 = value,
                None => options.push((name, value)),
            }
        }
        Ok(Task { kind, options, program })
    }
}

/// A key of the table.
enum TaskKey {
    Env,
    /// An option of some task, perhaps of another one.
    Option(&'static TaskOption),
    /// A key of a program.
    Program(&'static str),
}

struct KeySeed;

impl<'de> DeserializeSeed<'de> for KeySeed {
    type Value = TaskKey;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<TaskKey, D::Error> {
        deserializer.deserialize_identifier(self)
    }
}

impl Visitor<'_> for KeySeed {
    type Value = TaskKey;

    fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("the name of an option")
    }

    fn visit_str<E: serde::de::Error>(self, name: &str) -> Result<TaskKey, E> {
        if name == "env" {
            return Ok(TaskKey::Env);
        }
        let options = || registry().iter().flat_map(|kind| kind.options);
        if let Some(option) = options().find(|option| option.name == name) {
            return Ok(TaskKey::Option(option));
        }
        let of_program = process::fields().map(|(name, _)| name).into_iter().chain(process::MEMORY);
        if let Some(found) = of_program.clone().find(|known| *known == name) {
            return Ok(TaskKey::Program(found));
        }
        let mut known = vec!["env"];
        options().for_each(|option| known.extend((!known.contains(&option.name)).then_some(option.name)));
        Err(E::custom(format_args!("unknown field `{name}`, expected one of {}", quoted(&known))))
    }
}

struct KindSeed;

impl<'de> DeserializeSeed<'de> for KindSeed {
    type Value = &'static TaskKind;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Self::Value, D::Error> {
        deserializer.deserialize_str(self)
    }
}

impl Visitor<'_> for KindSeed {
    type Value = &'static TaskKind;

    fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("the name of a task")
    }

    fn visit_str<E: serde::de::Error>(self, name: &str) -> Result<Self::Value, E> {
        let known: Vec<&str> = registry().iter().map(|kind| kind.name).collect();
        let unknown = || E::custom(format_args!("unknown variant `{name}`, expected one of {}", quoted(&known)));
        task_kind(name).ok_or_else(unknown)
    }
}

struct ValueSeed(&'static TaskOption);

impl<'de> DeserializeSeed<'de> for ValueSeed {
    type Value = OptionValue;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<OptionValue, D::Error> {
        match self.0.default {
            OptionValue::Number(_) => f64::deserialize(deserializer).map(OptionValue::Number),
            OptionValue::Count(_) => u64::deserialize(deserializer).map(OptionValue::Count),
        }
    }
}

fn quoted(names: &[&str]) -> String {
    names.iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn task(table: serde_json::Value) -> Task {
        serde_json::from_value(table).expect("a task")
    }

    #[test]
    fn defaults_are_written_out_and_planar_has_none() {
        let explicit = |table| serde_json::to_string(&task(table)).unwrap();
        assert_eq!(explicit(json!({"env": "planar"})), r#"{"env":"planar","noise":0.0}"#);
        let swing_up = r#"{"env":"swing_up","noise":0.0,"step":0.05,"torque":0.65}"#;
        assert_eq!(explicit(json!({"env": "swing_up"})), swing_up);
        assert_eq!(explicit(serde_json::from_str(swing_up).unwrap()), swing_up);
        let two_links = explicit(json!({"links": 2, "env": "three_pole"}));
        assert_eq!(two_links, r#"{"env":"three_pole","noise":0.0,"step":0.05,"links":2}"#);
    }

    #[test]
    fn an_option_of_another_task_is_refused() {
        let [refused] = &task(json!({"env": "planar", "torque": 1.0})).check()[..] else { panic!("not one") };
        assert_eq!((refused.name, &*refused.why), ("torque", "is no option of `planar`"));
        assert_eq!(refused.help.as_deref(), Some("it has `noise`"));
    }

    #[test]
    fn options_out_of_range_are_refused_all_at_once() {
        let bad = json!({"env": "swing_up", "noise": -1, "step": 0, "torque": 1e9});
        let told: Vec<_> = task(bad).check().into_iter().map(|it| format!("{} {}", it.name, it.why)).collect();
        assert_eq!(
            told,
            [
                "noise must be 0 or above, but is `-1`",
                "step must be between 0.001 and 0.2, but is `0`",
                "torque must be between 0.01 and 100, but is `1000000000`",
            ]
        );
        let [links] = &task(json!({"env": "three_pole", "links": 4})).check()[..] else { panic!("not one") };
        assert_eq!(links.why, "must be 2 or 3, but is `4`");
    }

    #[test]
    fn a_table_with_a_mistake_is_no_task() {
        for (table, mistake) in [
            (json!({}), "missing field `env`"),
            (json!({"env": "planer"}), "unknown variant `planer`, expected one of `planar`, `swing_up`, `cart_pole`"),
            (json!({"env": "planar", "nois": 1}), "unknown field `nois`, expected one of `env`, `noise`, `step`"),
            (json!({"env": "planar", "noise": "loud"}), "invalid type: string \"loud\", expected f64"),
            (json!({"env": "three_pole", "links": 2.5}), "invalid type: floating point `2.5`, expected u64"),
        ] {
            let told = serde_json::from_value::<Task>(table.clone()).unwrap_err().to_string();
            assert!(told.starts_with(mistake), "{table}: {told}");
        }
    }

    #[test]
    fn every_environment_opens() {
        for (env, action, frames) in [("planar", 2, 1), ("swing_up", 1, 2), ("cart_pole", 1, 2), ("three_pole", 3, 2)] {
            let task = task(json!({ "env": env }));
            assert!(task.check().is_empty());
            assert_eq!(task.name(), env);
            let spec = task.spec();
            assert_eq!((spec.action_limit.len(), spec.frames.count), (action, frames));
            let (height, width) = spec.frames.observation();
            assert_eq!(task.open().unwrap().observe().len(), height * width);
        }
    }
}
