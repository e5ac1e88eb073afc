//! The parameters of `train_solar`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::TrainSolar;
use crate::{
    lce::{Differences, ImageNetworks, SharedFrames, Sizes, shared_frames::FRAMES},
    nn::binary_images::PooledPatches,
    solar::{Push, trainer::Settings},
    stage::{MOST_PASSES, PresetOf, Refusal, Stage as _, StepScale, above_zero, count, within},
};

#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(in crate::stage) struct Params {
    /// The encoder and decoder.
    networks: Networks,
    /// Passes over the trajectories.
    pub(super) epochs: u64,
    /// Trajectories of a batch.
    pub(super) batch: u64,
    /// Adam step size, for the networks and for the model of costs.
    learning_rate: f64,
    /// The largest norm of the networks' gradient; a longer gradient is scaled to it.
    clip: f64,
    /// The step size of the natural gradient, per step of the trajectory and divided by the number of trajectories.
    dynamics_rate: f64,
    /// Whether every step of an episode has dynamics of its own.
    dynamics: GlobalDynamics,
    /// The dynamics of a new model, before any data.
    first_dynamics: FirstDynamics,
    /// The weight of everything but the likelihood of pictures.
    pub(super) beta: Beta,
    /// Passes between two recorded latent maps.
    pub(super) map_every: u64,
}

/// The encoder and decoder of a new model.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
enum Networks {
    /// Those of the paper's appendix.
    Paper,
    /// Fully connected networks that read and predict patches of pixels.
    PooledPatches(Patches),
    /// Patches, and the same network for each of two frames. A code holds positions and speeds.
    SharedFrames(FramePatches),
}

/// Patches of pixels.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
struct Patches {
    /// Rows and columns of a patch.
    side: u64,
}

impl Default for Patches {
    fn default() -> Self {
        Self { side: 4 }
    }
}

/// Patches of pixels of each frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
struct FramePatches {
    /// Rows and columns of a patch.
    side: u64,
    /// Positions of a code. It has as many speeds.
    coordinates: u64,
    /// A speed divided by this number is the change of its position from frame to frame.
    scale: f64,
}

impl Default for FramePatches {
    fn default() -> Self {
        Self { side: 4, coordinates: 2, scale: 2.0 }
    }
}

/// The global dynamics.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
enum GlobalDynamics {
    /// Every step of an episode has dynamics of its own.
    PerStep,
    /// All steps have the same dynamics.
    Shared,
}

/// The dynamics of a new model.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
enum FirstDynamics {
    /// SOLAR's own: the next code is the code, with a variance of 2.
    Prior,
    /// An action moves every code by the same vector.
    Push(Push),
}

/// A weight that grows after every batch.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(in crate::stage) struct Beta {
    /// Its value in the first batch.
    first: f64,
    /// What is added after every batch.
    growth: f64,
    /// Its largest value.
    most: f64,
}

impl Default for Beta {
    fn default() -> Self {
        Self { first: 1e-4, growth: 5e-5, most: 10.0 }
    }
}

impl Beta {
    /// Its value in a batch, counted from 0.
    pub(super) fn at(self, step: u64) -> f64 {
        (self.first + self.growth * step as f64).min(self.most)
    }
}

impl Default for Params {
    fn default() -> Self {
        Self {
            networks: Networks::Paper,
            epochs: 1000,
            batch: 2,
            learning_rate: 1e-3,
            clip: 5.0,
            dynamics_rate: 2e-5,
            dynamics: GlobalDynamics::PerStep,
            first_dynamics: FirstDynamics::Prior,
            beta: Beta::default(),
            map_every: 10,
        }
    }
}

impl crate::stage::Params for Params {
    const STEP_SCALES: &'static [StepScale] = &[
        StepScale::Grows("learning_rate"),
        StepScale::Grows("clip"),
        StepScale::Grows("dynamics_rate"),
        StepScale::Grows("beta.first"),
        StepScale::Grows("beta.most"),
    ];

    fn preset(of: &PresetOf<'_>) -> Self {
        of.lay_task_over(TrainSolar::KIND, Self::default())
    }

    fn check(&self) -> Vec<Refusal> {
        let mut refusals = Vec::new();
        count(&mut refusals, "epochs", self.epochs, 1..=MOST_PASSES);
        count(&mut refusals, "batch", self.batch, 1..=1000);
        count(&mut refusals, "map_every", self.map_every, 1..=MOST_PASSES);
        for (path, value) in [("learning_rate", self.learning_rate), ("clip", self.clip)] {
            above_zero(&mut refusals, path, value);
        }
        // A step of T times this, over N trajectories, must stay below 1.
        within(&mut refusals, "dynamics_rate", self.dynamics_rate, 0.0, 1e-3);
        for (path, value) in [("beta.first", self.beta.first), ("beta.growth", self.beta.growth)] {
            within(&mut refusals, path, value, 0.0, 1e6);
        }
        above_zero(&mut refusals, "beta.most", self.beta.most);
        if let FirstDynamics::Push(Push { scale, std, count }) = self.first_dynamics {
            within(&mut refusals, "first_dynamics.push.scale", scale, -1e3, 1e3);
            within(&mut refusals, "first_dynamics.push.std", std, 1e-3, 1e3);
            within(&mut refusals, "first_dynamics.push.count", count, 0.0, 1e6);
        }
        match self.networks {
            Networks::Paper => {}
            Networks::PooledPatches(Patches { side }) => {
                count(&mut refusals, "networks.pooled_patches.side", side, 1..=15);
            }
            Networks::SharedFrames(FramePatches { side, coordinates, scale }) => {
                count(&mut refusals, "networks.shared_frames.side", side, 1..=15);
                count(&mut refusals, "networks.shared_frames.coordinates", coordinates, 1..=4);
                within(&mut refusals, "networks.shared_frames.scale", scale, 1e-3, 1e3);
            }
        }
        refusals
    }
}

impl Params {
    /// The transitions that have dynamics of their own, in episodes of so many steps.
    pub(super) fn transitions(&self, steps: usize) -> usize {
        match self.dynamics {
            GlobalDynamics::PerStep => steps - 1,
            GlobalDynamics::Shared => 1,
        }
    }

    /// The push of a new model, if its dynamics begin with one.
    pub(super) fn push(&self) -> Option<Push> {
        match self.first_dynamics {
            FirstDynamics::Prior => None,
            FirstDynamics::Push(push) => Some(push),
        }
    }

    pub(super) fn settings(&self, steps: usize) -> Settings {
        Settings {
            learning_rate: self.learning_rate,
            clip: self.clip,
            dynamics_rate: self.dynamics_rate * steps as f64,
        }
    }

    /// The widths of the networks, for pictures of so many rows and columns that hold `frames` frames.
    pub(super) fn sizes(&self, sizes: Sizes, (rows, columns): (usize, usize), frames: usize) -> anyhow::Result<Sizes> {
        let cut = |rows: usize, side: u64, parameter: &str| {
            let side = side as usize;
            anyhow::ensure!(
                rows.is_multiple_of(side) && columns.is_multiple_of(side),
                "pictures of {rows} x {columns} pixels cannot be cut into patches of {side} x {side}: change `{parameter}`"
            );
            Ok(PooledPatches { columns, side })
        };
        let (images, latent) = match self.networks {
            Networks::Paper => return Ok(sizes),
            Networks::PooledPatches(Patches { side }) => {
                let patches = cut(rows, side, "networks.pooled_patches.side")?;
                (ImageNetworks::Patches(patches), sizes.latent)
            }
            Networks::SharedFrames(FramePatches { side, coordinates, scale }) => {
                anyhow::ensure!(
                    frames == FRAMES,
                    "`networks = \"shared_frames\"` needs observations of {FRAMES} frames; those of the task have {frames}"
                );
                let patches = cut(rows / FRAMES, side, "networks.shared_frames.side")?;
                let frames = SharedFrames {
                    read: patches,
                    predicted: patches,
                    coordinates: coordinates as usize,
                    differences: Differences::Scaled { scale },
                };
                (ImageNetworks::SharedFrames(frames), frames.latent())
            }
        };
        Ok(Sizes { images, latent, encoder: [128; 2], decoder: [128; 2], ..sizes })
    }
}
