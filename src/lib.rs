//! carl-pipe: declarative, cached, replayable pipelines for control-aware representation learning from pixels.

pub mod arrays;
pub mod artifact;
pub mod child;
pub mod cli;
pub mod control;
pub mod diag;
pub mod digest;
pub mod env;
pub mod failpoint;
pub mod lce;
pub mod nn;
pub mod node_name;
pub mod num;
pub mod onnx;
pub mod pipeline;
pub mod program;
pub mod python;
pub mod record;
pub mod report;
pub mod run;
pub mod solar;
pub mod stage;
pub mod store;
