//! The tasks: dynamics, images, starts, goals and defaults. A task is one file here and one line in `registry`.

mod cart_pole;
mod ceiling;
mod defaults;
mod drawing;
mod ode;
mod planar;
mod planner;
mod pole;
pub mod process;
mod registry;
mod simulator;
mod swing_up;
mod symmetry;
mod system;
mod task;
mod three_pole;

pub use cart_pole::CartPole;
pub use ceiling::Protocol;
pub(crate) use defaults::chosen;
pub use defaults::{BackwardSizes, DefaultsOf, NetworkSizes, Preset};
pub use planar::Planar;
pub use registry::{OptionValue, TaskKind, TaskOption, World, add_to_registry, registry, task_kind};
pub use simulator::{Frames, Simulator, Snapshot, Spec};
pub use swing_up::SwingUp;
pub use symmetry::{SeenTransition, Symmetry};
pub use system::{Oracle, System, simulate};
pub use task::{RefusedOption, Task};
pub use three_pole::ThreePole;

/// Where the episodes of an evaluation start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Start {
    /// At the start that the task declares.
    #[default]
    Usual,
    /// At the start of the paper's text: pendulum and arm hang, the arm at π, 2π/3 and π/3. Other tasks start as usual.
    Paper,
    /// Always at the same state: the point at (5, 5), the pendulum at 0.925π, the cart-pole at π/12.
    Fixed,
    /// The cart-pole within ±π/10, where the pole is at its goal already. Other tasks start as usual.
    Narrow,
}
