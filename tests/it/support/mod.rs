//! What several tests need.

pub mod cli;
pub mod desk;
#[path = "../../support/models.rs"]
pub mod models;
pub mod mutated;
pub mod pipeline;
pub mod python;
pub mod recording;
pub mod run;
pub mod small_disk;
pub mod stages;
