//! The tasks that the program knows, and what a task's file declares.

use std::{ops::RangeInclusive, sync::OnceLock};

use serde_json::Value;

use super::{
    DefaultsOf, NetworkSizes, Simulator, Spec, Start, Symmetry, System, Task, cart_pole, planar, process, swing_up,
    three_pole,
};

/// One task. Its file declares everything that depends on the task.
pub struct TaskKind {
    /// The `env` that pipeline files write.
    pub name: &'static str,
    /// One line that says what the task is.
    pub about: &'static str,
    /// The options of `[task]`, in the order in which a key lists them.
    pub options: &'static [TaskOption],
    /// What moves when an action is applied.
    pub world: World,
    /// Exact symmetries of the dynamics and the pictures, which training may apply to its transitions.
    pub symmetries: &'static [Symmetry],
    /// Widths of the networks that learn this task.
    pub networks: fn(&Task) -> NetworkSizes,
    /// Parameters of a stage kind that differ from the kind's general preset, as a table that is laid over it.
    pub defaults: fn(&DefaultsOf<'_>) -> Value,
    /// Mean %-goal of the best controller known, with the task's own goals and radius, counting T+1 states; `None` with
    /// options under which it was not measured.
    pub ceiling: fn(&Task, Start) -> Option<f64>,
    /// Mean %-goal of online CARL in the paper's Table 1, if the table has this system.
    pub paper_online: fn(&Task) -> Option<f64>,
}

/// What moves when an action is applied. [`Task::check`] has accepted the options of the task.
#[derive(Debug, Clone, Copy)]
pub enum World {
    /// Equations over known states. The program simulates them.
    System(fn(&Task) -> Box<dyn System>),
    /// A simulator that does not tell its equations, such as another process.
    Simulator {
        /// What is known before the simulator is started.
        spec: fn(&Task) -> Spec,
        /// Starts the simulator.
        open: fn(&Task) -> anyhow::Result<Box<dyn Simulator>>,
    },
    /// A program that `[task]` names, in another process.
    Process,
}

impl std::fmt::Debug for TaskKind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "TaskKind({})", self.name)
    }
}

/// An option of `[task]`.
#[derive(Debug, Clone, PartialEq)]
pub struct TaskOption {
    /// The key that pipeline files write.
    pub name: &'static str,
    /// The value where a file writes none.
    pub default: OptionValue,
    /// The values that are accepted, both ends included.
    pub range: RangeInclusive<f64>,
    /// The unit of the value, such as `s`; empty for a count.
    pub unit: &'static str,
    /// One line that says what the option changes.
    pub about: &'static str,
}

impl TaskOption {
    /// The standard deviation of the process noise, which every built-in task has.
    pub const NOISE: Self = Self {
        name: "noise",
        default: OptionValue::Number(0.0),
        range: 0.0..=f64::MAX,
        unit: "units of the state",
        about: "standard deviation of the process noise",
    };

    /// The control step, from 0.05 s unless a file says otherwise.
    pub const STEP: Self =
        Self { name: "step", default: OptionValue::Number(0.05), range: 0.001..=0.2, unit: "s", about: "control step" };

    /// The accepted values in words, such as `between 0.001 and 0.2`.
    pub fn range_in_words(&self) -> String {
        let (low, high) = (self.range.start(), self.range.end());
        match self.default {
            _ if *high == f64::MAX => format!("{low} or above"),
            OptionValue::Count(_) if low + 1.0 == *high => format!("{low} or {high}"),
            _ => format!("between {low} and {high}"),
        }
    }
}

/// The value of an option. Its kind decides which numbers a file may write.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
#[serde(untagged)]
pub enum OptionValue {
    /// A real number.
    Number(f64),
    /// A whole number from 0 up.
    Count(u64),
}

impl OptionValue {
    /// The value as a real number.
    pub fn as_f64(self) -> f64 {
        match self {
            Self::Number(number) => number,
            Self::Count(count) => count as f64,
        }
    }
}

/// The tasks that come with the program.
const BUILT_IN: [&TaskKind; 5] = [&planar::TASK, &swing_up::TASK, &cart_pole::TASK, &three_pole::TASK, &process::TASK];

static REGISTRY: OnceLock<Vec<&'static TaskKind>> = OnceLock::new();

/// Every task that the program knows.
pub fn registry() -> &'static [&'static TaskKind] {
    REGISTRY.get_or_init(|| BUILT_IN.to_vec())
}

/// Adds tasks to the built-in ones. The registry is global because serde reads a [`Task`] without a context. Call this
/// once, before anything reads a task.
///
/// # Panics
/// If the registry was read or extended before, or if two tasks have the same name.
pub fn add_to_registry(own: &[&'static TaskKind]) {
    let all: Vec<&'static TaskKind> = BUILT_IN.iter().chain(own).copied().collect();
    for (at, kind) in all.iter().enumerate() {
        assert!(all[..at].iter().all(|other| other.name != kind.name), "two tasks are called `{}`", kind.name);
    }
    assert!(REGISTRY.set(all).is_ok(), "tasks must be added before the registry is first read");
}

/// The task called `name`.
pub fn task_kind(name: &str) -> Option<&'static TaskKind> {
    registry().iter().find(|kind| kind.name == name).copied()
}
