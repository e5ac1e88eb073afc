//! Runs a graph: computes the key of every result, finds which results the store has, makes the rest, and keeps a
//! record of the run.

mod alive;
pub mod changes;
pub mod events;
pub mod execute;
pub mod gc;
pub mod holdings;
pub mod job;
pub mod key;
pub mod manifest;
pub mod marks;
mod named_files;
pub mod node;
pub mod plan;
pub mod recordings;
pub mod repair;
pub mod replay;
pub mod runs;
mod salvage;
mod strays;
mod utc;
pub mod verify;
pub mod why;
