//! Networks that read every frame of an observation with the same weights.
//!
//! One network g reads each frame. A code holds the m coordinates of the newest frame, g(new). After them it may hold
//! differences to the older frame, scaled or mixed. So a code holds positions and speeds, and g learns from both
//! frames. If a code determines the coordinates of the older frame, D decodes each frame by the same network, too.

use crate::nn::binary_images::PooledPatches;

/// Frames of an observation that such networks read.
pub const FRAMES: usize = 2;

/// The form of such networks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SharedFrames {
    /// The patches that E and B read.
    pub read: PooledPatches,
    /// The patches that D predicts. Their side is a multiple of the side of those that are read.
    pub predicted: PooledPatches,
    /// m, the coordinates of the newest frame.
    pub coordinates: usize,
    /// The differences to the older frame.
    pub differences: Differences,
}

/// What a code holds of the difference g(new) - g(old).
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Differences {
    /// Nothing: a code shows the newest frame alone.
    None,
    /// All m differences, times a scale. D decodes each frame from the coordinates of that frame.
    Scaled {
        /// Factor on the differences.
        scale: f64,
    },
    /// A learned affine function of the differences, times a scale. D decodes both frames from the whole code.
    Mixed {
        /// Factor on the function.
        scale: f64,
        /// Outputs of the function.
        coordinates: usize,
    },
}

/// The form of codes that hold speeds: the first coordinates are positions, and as many speeds come after them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Speeds {
    /// The number of positions, which is also the number of speeds.
    pub positions: usize,
    /// A speed divided by this number is the change of its position from the older to the newest frame.
    pub scale: f64,
}

impl SharedFrames {
    /// Dimension of the latent space.
    pub fn latent(&self) -> usize {
        self.coordinates
            + match self.differences {
                Differences::None => 0,
                Differences::Scaled { .. } => self.coordinates,
                Differences::Mixed { coordinates, .. } => coordinates,
            }
    }
}
