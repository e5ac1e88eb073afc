//! A SOLAR model: encoder and decoder, the global dynamics, and the model of costs.

use super::{
    Small,
    mniw::{Mniw, Natural},
    objective::CostModel,
};
use crate::{
    lce::{BackwardSizes, LceModel, Sizes},
    nn::adam::Adam,
    num::{rng::Rng, sampling},
};

/// Added to the standard deviation of every code. Without it, precisions explode.
pub const FLOOR: f64 = 0.01;
/// Standard deviation of the first means of F around \[I 0\].
const FIRST_STD: f64 = 0.01;

/// The first dynamics of a model, before any data: z' ~ N(z + scale \[u; 0\], std² I).
///
/// From SOLAR's own start, E Σ = 2I, the dynamics say nothing of where codes lie, and the decoder lays them out as it
/// likes. From this start, an action moves every code by the same vector, as under the anchor of CARL's warm-up.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Push {
    /// How far one unit of action moves a code.
    pub scale: f64,
    /// Standard deviation of the next code.
    pub std: f64,
    /// The number of transitions that the start counts as.
    pub count: f64,
}

/// A model and its optimisers.
#[derive(Debug, Clone, PartialEq)]
pub struct SolarModel {
    /// E and D. F and B have one unit a layer and are not used.
    pub networks: LceModel,
    /// Adam's moments for the networks.
    pub adam: Adam<f32>,
    /// Natural parameters of q(F, Σ): for every transition of an episode, or one for all.
    pub dynamics: Vec<Natural>,
    /// The model of costs.
    pub cost: CostModel,
    /// Adam's moments for the model of costs.
    pub cost_adam: Adam<f64>,
}

impl Default for Push {
    fn default() -> Self {
        Self { scale: 0.25, std: 0.05, count: 1000.0 }
    }
}

impl Push {
    /// q(F, Σ) for codes of d components that follow from p components of codes and actions.
    fn dynamics(self, d: usize, p: usize) -> Mniw {
        let prior = Mniw::prior(d, p);
        let entry = |i, j| match j {
            _ if i == j => 1.0,
            _ if i + d == j => self.scale,
            _ => 0.0,
        };
        Mniw {
            // E Σ = Ψ / (ν - d - 1).
            psi: Small::diagonal(d, self.std * self.std * (self.count + 1.0)),
            m: Small::from_fn(d, p, entry),
            v: Small::diagonal(p, 1.0 / (self.count + 1.0)),
            nu: prior.nu + self.count,
        }
    }
}

/// Units of the layers of an F that nothing uses.
const NO_DYNAMICS: [usize; 2] = [1, 1];

/// Whether these are the widths of a SOLAR model.
pub fn is_without_dynamics(sizes: &Sizes) -> bool {
    sizes.dynamics == NO_DYNAMICS
}

/// The widths of a SOLAR model: those of an LCE model without F and B.
pub fn without_dynamics(sizes: Sizes) -> Sizes {
    Sizes { dynamics: NO_DYNAMICS, backward: BackwardSizes { z: 1, u: 1, x: 1, joint: 1 }, ..sizes }
}

impl SolarModel {
    /// A model with random weights, for `transitions` transitions (1 where all have the same dynamics).
    ///
    /// Its dynamics are SOLAR's own start, or a push.
    pub fn new(sizes: Sizes, background: Vec<u8>, transitions: usize, push: Option<Push>, rng: &mut Rng) -> Self {
        let (d, p) = (sizes.latent, sizes.latent + sizes.action);
        let networks = LceModel::new(without_dynamics(sizes), background, rng);
        let adam = Adam::new(networks.arena.len());
        let mut noise = vec![0.0; d * p];
        let dynamics = (0..transitions).map(|_| {
            sampling::fill_normal(rng, &mut noise);
            let first = push.map_or(Mniw::prior(d, p), |push| push.dynamics(d, p));
            let m = first.m.plus(FIRST_STD, &Small::from_rows(d, p, &noise));
            Mniw { m, ..first }.natural().expect("V is a multiple of the identity")
        });
        let dynamics = dynamics.collect();
        let mut weights = vec![0.0; d * d + d];
        sampling::fill_normal(rng, &mut weights);
        let cost_adam = Adam::new(weights.len());
        Self { networks, adam, dynamics, cost: CostModel { weights }, cost_adam }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn after_a_push_an_action_moves_a_code_by_its_scale() {
        let push = Push { scale: 0.25, std: 0.05, count: 1000.0 };
        // Codes of 2 components and actions of 1.
        let first = push.dynamics(2, 3);
        let next = first.m.times(&Small::column(&[1.0, -2.0, 0.8]));
        assert_eq!(next.iter().collect::<Vec<_>>(), [1.2, -2.0]);
        let variances = first.expected_sigma();
        assert!((variances.at(0, 0) - 0.0025).abs() < 1e-15 && variances.at(0, 1) == 0.0, "{variances:?}");
    }
}
