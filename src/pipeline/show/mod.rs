//! Pipelines and kinds for people to read.

mod catalogue;
mod dag;
mod schema;
mod wrap;

pub use catalogue::{stages_json, stages_text};
pub use dag::{dag_mermaid, dag_text, dag_text_expanded};
pub use schema::schema;
