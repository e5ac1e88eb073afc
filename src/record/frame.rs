//! Typed messages: the form in which every view of a recording gets them, and the forms that a stage records.

use std::sync::Arc;

use super::time::At;

/// A decoded message.
#[derive(Debug, Clone, PartialEq)]
pub struct Message {
    /// The topic, such as `/train/lce`.
    pub topic: String,
    /// The logical time.
    pub at: At,
    /// The content.
    pub frame: Frame,
}

/// The content of a message.
#[derive(Debug, Clone, PartialEq)]
pub enum Frame {
    /// Named values.
    Scalars {
        /// The name of each value.
        names: Arc<[String]>,
        /// The values.
        values: Vec<f64>,
    },
    /// The latents of known states.
    LatentMap {
        /// True positions of the states as row and column, both in 0..=1.
        positions: Vec<[f32; 2]>,
        /// The latents of the states.
        latents: Vec<[f32; 3]>,
        /// The colour of each true position: red, green, blue, opacity.
        colours: Vec<[u8; 4]>,
    },
    /// The latents of the goals.
    Goals(Vec<[f32; 3]>),
    /// Circles in true space, each as row, column and radius.
    Obstacles(Vec<[f32; 3]>),
    /// A picture.
    Picture {
        /// Number of rows.
        height: u32,
        /// Number of columns.
        width: u32,
        /// One byte per pixel, or three for red, green and blue, row by row; 0 is black.
        bytes: Vec<u8>,
    },
    /// One evaluated episode in true space.
    Trajectory {
        /// Number of the episode within the evaluation.
        episode: u32,
        /// The states as row and column.
        path: Vec<[f32; 2]>,
        /// The goal as row and column.
        goal: [f32; 2],
        /// Distance from the goal within which a state counts as reached.
        radius: f32,
        /// Share of the states within the radius, in percent.
        percent_goal: f64,
    },
    /// A text.
    Log {
        /// The severity.
        level: Level,
        /// The text.
        text: String,
    },
}

/// The severity of a text.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Level {
    /// For somebody who looks for the cause of a problem.
    Debug,
    /// For everybody.
    Info,
    /// Something looks wrong.
    Warning,
    /// Something is wrong.
    Error,
}

impl Level {
    /// The number of `foxglove.Log.Level`.
    pub(super) fn to_wire(self) -> i32 {
        match self {
            Level::Debug => 1,
            Level::Info => 2,
            Level::Warning => 3,
            Level::Error => 4,
        }
    }

    /// The level of a number of `foxglove.Log.Level`. An unknown level counts as [`Level::Info`], a fatal one as
    /// [`Level::Error`].
    pub(super) fn from_wire(level: i32) -> Level {
        match level {
            1 => Level::Debug,
            3 => Level::Warning,
            4.. => Level::Error,
            _ => Level::Info,
        }
    }
}

/// The latents of known states, as a stage records them.
#[derive(Debug, Clone, Copy)]
pub struct MapFrame<'a> {
    /// True positions as row and column, both in 0..=1. They give the colours.
    pub positions: &'a [[f32; 2]],
    /// The latents of the same states. A two-dimensional latent is padded with 0.
    pub latents: &'a [[f32; 3]],
    /// The latents of the goals.
    pub goals: &'a [[f32; 3]],
    /// How well the map keeps the shape of the true space; higher is better. Recorded as `TOPIC/quality`.
    pub quality: f64,
}

/// One evaluated episode in true space, as a stage records it.
#[derive(Debug, Clone, Copy)]
pub struct TrajectoryFrame<'a> {
    /// Number of the episode within the evaluation.
    pub episode: u32,
    /// The states as row (drawn downwards) and column (drawn rightwards).
    pub path: &'a [[f32; 2]],
    /// The goal as row and column.
    pub goal: [f32; 2],
    /// Distance from the goal within which a state counts as reached.
    pub radius: f32,
    /// Share of the states within the radius, in percent.
    pub percent_goal: f64,
}
