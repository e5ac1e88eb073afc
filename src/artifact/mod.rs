//! The typed values that stages hand to each other, and their files.

mod agent;
mod collected;
mod evaluation;
mod finite;
mod ilqr;
mod latent_map;
mod lce_model;
mod sizes;
mod solar;
mod summary;
pub(crate) mod tensors;
mod trajectories;
mod transitions;

pub use crate::store::Files;
pub use collected::Collected;
pub use evaluation::{EpisodeResult, Evaluation};
pub use finite::must_be_finite;
pub use latent_map::{Codes, LatentAxis, LatentMap};
pub use lce_model::{EncoderOf, TrainedModel};
pub(crate) use solar::{put_plans, take_plans};
pub use summary::{MetricSummary, ResultSummary};
pub use trajectories::Trajectories;
pub use transitions::Transitions;

/// A value that one stage makes and others take.
///
/// Tensors are `.safetensors` files and metrics are `.json` files, so Python opens every artifact without this program.
/// Equal values give equal bytes: `save` writes in a fixed order, and no clock, path or host name.
pub trait Artifact: Sized + Send + 'static {
    /// The name that ports and error messages use, such as `lce_model`.
    const TYPE: &'static str;
    /// Other types of artifact that can be read from the same files. A port that takes one of them takes this too.
    const READABLE_AS: &'static [&'static str] = &[];
    /// Keys of JSON files whose value may be `null`, because nothing was measured. All other numbers are finite: files with
    /// other ones are neither published nor read.
    const MAY_BE_MISSING: &'static [&'static str] = &[];

    /// Turns the value into files.
    fn save(self) -> anyhow::Result<Files>;

    /// Reads what `save` wrote.
    ///
    /// # Errors
    /// A file is missing, or it holds something else.
    fn load(files: &Files) -> anyhow::Result<Self>;
}

/// A metrics file: JSON with one field on each line.
pub(crate) fn json<T: serde::Serialize>(value: &T) -> anyhow::Result<Vec<u8>> {
    let mut bytes = serde_json::to_vec_pretty(value)?;
    bytes.push(b'\n');
    Ok(bytes)
}
