//! Networks by hand on faer matrices: layers, heads, Adam.

pub mod adam;
pub mod binary_images;
pub(crate) mod columns;
pub mod conv;
pub mod heads;
pub mod mat;
pub mod mlp;
