//! Environments, losses, training and artifacts against golden data.

mod absurd_sizes;
mod artifacts;
mod artifacts_python;
mod determinism;
mod divergence;
mod environments;
mod finite_artifacts;
mod golden_environments;
mod golden_losses;
mod golden_solar;
mod gradients;
mod instruction_sets;
mod map_checks;
mod onnx_policy;
mod pinned_digests;
mod resume;
mod solar;
mod stages_on_poles;
mod states_stay_hidden;
mod symmetries;
