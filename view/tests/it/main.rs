//! Tests of the view: the follower, the Rerun file, and viewers that hang.

mod follow;
mod hung_viewer;
mod program;
mod rerun_file;
#[path = "../../../tests/it/support/recording.rs"]
mod sample_run;
