//! Sizes of a training step on the planar task.

pub const BATCH: usize = 128;
pub const PIXELS: usize = 1600;
pub const LATENT: usize = 2;
pub const ACTION: usize = 2;
