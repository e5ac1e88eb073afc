//! Environments in another process, such as those of Gymnasium: a task without a line of Rust.

mod connection;
mod defaults;
mod look;
mod program;
mod simulator;
mod wire;

use super::{TaskKind, World};

pub use connection::Connection;
pub use look::Unusable;
pub(super) use program::MEMORY;
pub use program::{Found, Program, fields};
pub use wire::{About, PROTOCOL, Reset, Seen, Step};

pub(super) use simulator::open;

/// The task `process`.
pub(super) const TASK: TaskKind = TaskKind {
    name: "process",
    about: "an environment in another process",
    options: &[],
    world: World::Process,
    symmetries: &[],
    networks: |task| defaults::widths(&task.spec()),
    defaults: defaults::defaults,
    ceiling: |_, _| None,
    paper_online: |_| None,
};
