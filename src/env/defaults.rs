//! What a task's file tells the stages: defaults of their parameters, and widths of networks.

use serde_json::{Map, Value};

use super::Task;

/// Which table of defaults fills the parameters that a file does not write.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Preset {
    /// Our values: what was measured to work.
    Recipe,
    /// The paper's values, to the letter.
    Paper,
}

/// What the defaults of a task may depend on.
#[derive(Debug, Clone, Copy)]
pub struct DefaultsOf<'a> {
    /// The task, with its options.
    pub task: &'a Task,
    /// The name of the stage kind, such as `train_sac`.
    pub stage: &'a str,
    /// Which table.
    pub preset: Preset,
    /// The parameters that the file writes. A choice such as `objective` may decide over other defaults.
    pub given: &'a Map<String, Value>,
}

impl<'a> DefaultsOf<'a> {
    /// The choice that the file writes for a parameter, such as `objective`.
    pub fn chosen(&self, parameter: &str) -> Option<&'a str> {
        chosen(self.given, parameter)
    }
}

/// The choice that a file writes for a parameter: `"pcc"`, or the one key of `{ value_guided = { … } }`.
pub(crate) fn chosen<'a>(given: &'a Map<String, Value>, parameter: &str) -> Option<&'a str> {
    match given.get(parameter)? {
        Value::String(word) => Some(word),
        Value::Object(table) if table.len() == 1 => table.keys().next().map(String::as_str),
        _ => None,
    }
}

/// Widths of the networks that learn a task (paper, appendix "Network Architectures").
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NetworkSizes {
    /// Dimension of the latent space, z.
    pub latent: usize,
    /// Whether encoder and decoder are convolutional.
    pub is_convolutional: bool,
    /// Hidden layers of the encoder. The first follows the convolutions.
    pub encoder: [usize; 2],
    /// Hidden layers of the decoder. The last precedes the convolutions.
    pub decoder: [usize; 2],
    /// Hidden layers of the dynamics.
    pub dynamics: [usize; 2],
    /// Layers of the backward dynamics.
    pub backward: BackwardSizes,
}

/// Widths of the layers of the backward dynamics (paper, appendix "Network Architectures").
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BackwardSizes {
    /// N_z, the layer that reads the next latent state.
    pub latent: usize,
    /// N_u, the layer that reads the action.
    pub action: usize,
    /// N_x, the layer that reads the observation.
    pub observation: usize,
    /// N_joint, the layer that reads the three layers above.
    pub joint: usize,
}
