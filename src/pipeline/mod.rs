//! Pipeline files: text in, a [`Graph`] of nodes out, or all mistakes with their places.
//!
//! Reading goes in three passes. `syntax` turns text into a parsed pipeline, every part with its place. `resolve` looks
//! up names and computes the parameters at every point of the matrix. `graph` unrolls loop and matrix into nodes.
//! `load` reads the files and runs the passes, `show` prints pipelines and kinds.

mod graph;
mod limits;
mod load;
mod messages;
mod resolve;
mod show;
mod syntax;

pub use graph::node::{BaseFile, Graph, Member, Node, NodeFile, NodeId};
pub use load::{Reader, Source, load, load_with};
pub use show::{dag_mermaid, dag_text, dag_text_expanded, schema, stages_json, stages_text};
pub use syntax::arguments::Overrides;
