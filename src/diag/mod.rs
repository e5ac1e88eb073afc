//! Mistakes in what a user wrote: every one underlined where it stands, all of them in one report.

mod mistake;
mod report;
mod sources;
mod suggest;
mod visible;

pub use mistake::Diagnostic;
pub use report::Diagnostics;
pub use sources::{Sources, Span, line_and_column};
pub use suggest::{instead, nearest};
pub use visible::{is_hidden, visible};
