//! Hand-written networks: dense and convolutional layers with their gradients, output distributions, and Adam.
//!
//! Parameters of a model lie in one flat arena. Batches are column-major: one column per sample.

pub mod adam;
pub mod binary_images;
pub(crate) mod columns;
pub mod conv;
pub mod heads;
pub mod mat;
pub mod mlp;
