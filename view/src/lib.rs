//! Shows carl-pipe's runs and recordings in the Rerun viewer, while a run works and after it has ended.
//!
//! The view reads files alone: a run's `events.jsonl` and the MCAP recordings that its nodes write. A run never waits
//! for its view, and a viewer that hangs or dies cannot change a run. A live view and a later view of the same run are
//! drawn by the same code, so they look the same.

mod blueprint;
mod connect;
mod event_log;
mod follow;
mod host;
mod open;
mod playback;
mod rerun_viewer;
mod run_view;
mod style;
mod timeline;
mod viewer;

pub use follow::follow;
pub use host::ViewHost;
pub use open::open;
pub use rerun_viewer::RerunViewer;
pub use viewer::{Position, Viewer};
