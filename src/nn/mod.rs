//! Networks by hand on faer matrices: layers, heads, Adam.

pub mod adam;
pub(crate) mod columns;
pub mod conv;
pub mod heads;
pub mod mat;
pub mod mlp;
pub mod pictures;
