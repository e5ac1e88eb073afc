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

/// The widths of a SOLAR model: those of an LCE model without F and B.
pub fn without_dynamics(sizes: Sizes) -> Sizes {
    Sizes { dynamics: [1, 1], backward: BackwardSizes { z: 1, u: 1, x: 1, joint: 1 }, ..sizes }
}

impl SolarModel {
    /// A model with random weights, for `transitions` transitions (1 where all have the same dynamics).
    pub fn new(sizes: Sizes, background: Vec<u8>, transitions: usize, rng: &mut Rng) -> Self {
        let (d, p) = (sizes.latent, sizes.latent + sizes.action);
        let networks = LceModel::new(without_dynamics(sizes), background, rng);
        let adam = Adam::new(networks.arena.len());
        let mut noise = vec![0.0; d * p];
        let dynamics = (0..transitions).map(|_| {
            sampling::fill_normal(rng, &mut noise);
            let prior = Mniw::prior(d, p);
            let m = prior.m.plus(FIRST_STD, &Small::from_rows(d, p, &noise));
            Mniw { m, ..prior }.natural().expect("V is the identity")
        });
        let dynamics = dynamics.collect();
        let mut weights = vec![0.0; d * d + d];
        sampling::fill_normal(rng, &mut weights);
        let cost_adam = Adam::new(weights.len());
        Self { networks, adam, dynamics, cost: CostModel { weights }, cost_adam }
    }
}
