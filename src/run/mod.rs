//! Runs a graph: names each result before it exists, finds which the store has, makes the rest and keeps what happened.

pub mod events;
pub mod execute;
pub mod gc;
pub mod key;
pub mod manifest;
pub mod plan;
pub mod replay;
pub mod runs;
pub mod why;
