//! The reward of a step in the latent space.

/// The reward of reaching z'.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Reward {
    /// -|z_g - z'|, as in the paper's algorithm.
    Distance,
    /// -50 |z_g - z'|² - |a|², as in the paper's appendix.
    Quadratic,
}

impl Reward {
    /// The reward of reaching `z_next` by `action`, where `z_goal` is the goal's code.
    #[inline(always)]
    pub(in crate::control) fn of(self, action: &[f32], z_next: &[f32], z_goal: &[f32]) -> f32 {
        self.at(action, z_next.iter().zip(z_goal).map(|(z, g)| z - g))
    }

    /// The reward of reaching a code by `action`, from the coordinates of its difference to the goal's code.
    #[inline(always)]
    pub(super) fn at(self, action: &[f32], difference: impl Iterator<Item = f32>) -> f32 {
        let squared = difference.map(|d| d * d).sum::<f32>();
        match self {
            Self::Distance => -squared.sqrt(),
            Self::Quadratic => -50.0 * squared - action.iter().map(|u| u * u).sum::<f32>(),
        }
    }
}
