//! The tasks: dynamics, pictures, starts and goals.

use serde::{Deserialize, Serialize};

/// The `[task]` table of a pipeline, every option explicit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Task {
    /// Which environment.
    pub env: EnvName,
    /// Standard deviation of the process noise, in units of the state.
    #[serde(default)]
    pub noise: f64,
}

/// The environments there are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum EnvName {
    /// Navigation among obstacles.
    Planar,
}
