//! Second pass: a parsed pipeline to a resolved one. Kinds, ports, references and axes are looked up and checked, and
//! tasks and parameters are computed at every point of the matrix.

mod axes;
pub(crate) mod choices;
mod defaults;
pub(crate) mod names;
pub(crate) mod params;
pub(crate) mod points;
pub(crate) mod resolved;
mod schema;
mod streams;
pub(crate) mod task;
pub(crate) mod types;
mod wiring;
