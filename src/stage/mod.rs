//! The kinds of stage that a pipeline can name, and the contract of a stage.
//!
//! A kind is one file in this folder, named after the kind, and one line in [`registry`].

mod collect;
mod command;
mod control_ilqr;
mod control_solar;
mod controllers;
mod cx;
mod declared;
mod distill_policy;
mod divergence;
mod evaluate;
mod export_latent_map;
mod fits;
mod generate_data;
mod generate_trajectories;
mod import_data;
mod inputs;
mod kind;
pub(crate) mod memory;
mod networks;
mod one_goal;
mod outside;
mod params;
mod probe;
mod state;
mod state_cost;
mod summarize;
mod symmetries;
mod train_lce;
mod train_sac;
mod train_solar;

use crate::artifact::Artifact;

pub use crate::env::Preset;
pub use cx::{Host, Interrupted, StageCx};
pub use declared::{ANY, Declared};
pub use divergence::{Diverged, StepScale};
pub(crate) use inputs::inputs;
pub use inputs::{Arity, InputFiles, Inputs, Port, PortField, load_port};
pub use kind::{Kind, kind, registry, registry_with};
pub use memory::{MOST_MEMORY, Memory};
pub use networks::network_sizes;
pub use outside::{NamedFile, NothingOutside, Outside};
pub(crate) use params::NoParams;
pub use params::{MOST_COPIES, MOST_PASSES, MOST_STEPS, Params, PresetOf, Refusal, above_zero, count, within};
pub use state::StageState;
pub use symmetries::{SymmetricCopies, Symmetries};

/// One kind of stage: it takes typed parameters and inputs, and makes one artifact.
///
/// The output depends on parameters, inputs, the task and the random streams of the context alone. It does not depend
/// on the clock, on paths or on the number of threads.
pub trait Stage: 'static {
    /// The `kind` that pipeline files write.
    const KIND: &'static str;
    /// Raise it when the same parameters and inputs would give other bytes.
    const VERSION: u32;
    /// One line for `carl-pipe stages`.
    const ABOUT: &'static str;
    /// The metric that models are judged by, where this stage measures one model: tables, charts and the closing line
    /// of a run show it. `None` for every other stage.
    const HEADLINE: Option<&'static str> = None;
    /// Whether two stages of the kind with the same random stream repeat each other, as far as their inputs are equal.
    const REPEATS: bool = true;
    /// The parameters that a pipeline file may set.
    type Params: Params;
    /// The artifacts that other stages hand in.
    type Inputs: Inputs;
    /// The artifact that this stage makes.
    type Output: Artifact;

    /// Does the work.
    fn run(params: &Self::Params, inputs: Self::Inputs, cx: &mut StageCx<'_>) -> anyhow::Result<Self::Output>;
}
