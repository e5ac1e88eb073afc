//! The typed values that stages hand to each other, and how they lie on disk.

mod agent;
mod collected;
mod evaluation;
mod ilqr;
mod latent_map;
mod lce_model;
mod sizes;
mod summary;
pub(crate) mod tensors;
mod transitions;

pub use crate::store::Files;
pub use collected::Collected;
pub use evaluation::{EpisodeResult, Evaluation};
pub use latent_map::{Codes, LatentAxis, LatentMap};
pub use lce_model::TrainedModel;
pub use summary::{MetricSummary, ResultSummary};
pub use transitions::Transitions;

/// A value that one stage makes and others take.
///
/// Tensors lie in `.safetensors` and metrics in `.json`, so every artifact opens in Python without us. Equal values
/// give equal bytes: `save` writes in a fixed order, without clock, path or host.
pub trait Artifact: Sized + Send + 'static {
    /// The name that ports and error messages use, such as `lce_model`.
    const TYPE: &'static str;

    /// Writes the value as files.
    fn save(&self) -> anyhow::Result<Files>;

    /// Reads what `save` wrote; says what is wrong with files that it did not write.
    fn load(files: &Files) -> anyhow::Result<Self>;
}

/// A metrics file: readable JSON, one field a line.
pub(crate) fn json<T: serde::Serialize>(value: &T) -> anyhow::Result<Vec<u8>> {
    let mut bytes = serde_json::to_vec_pretty(value)?;
    bytes.push(b'\n');
    Ok(bytes)
}
