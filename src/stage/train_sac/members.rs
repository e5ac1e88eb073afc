//! The parameters of the ensemble that latent rollouts follow.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{
    lce::{
        Ensemble, LceModel,
        ensemble::{Fit, Moves},
    },
    num::rng::Rng,
    stage::{MOST_STEPS, Refusal, SymmetricCopies, above_zero, count, divergence::TrainingStep, fits},
};

/// The members of an ensemble and how they are fitted.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Members {
    /// Number of networks. Each is fitted from random weights to its own bootstrap sample of the transitions. With 0,
    /// latent rollouts follow the model's F.
    members: u64,
    /// Steps of each fit.
    steps: u64,
    /// Adam step size of the first step of a fit. It falls linearly to zero.
    learning_rate: f64,
}

impl Default for Members {
    fn default() -> Self {
        Self { members: 0, steps: 3000, learning_rate: 2e-3 }
    }
}

impl Members {
    pub(super) fn check(&self, refusals: &mut Vec<Refusal>) {
        count(refusals, "ensemble.members", self.members, 0..=100);
        count(refusals, "ensemble.steps", self.steps, 1..=MOST_STEPS);
        above_zero(refusals, "ensemble.learning_rate", self.learning_rate);
    }

    /// The fitted ensemble; `None` if it has no members.
    pub(super) fn fit(
        &self,
        model: &LceModel,
        copies: SymmetricCopies<'_>,
        rng: &mut Rng,
    ) -> anyhow::Result<Option<Ensemble>> {
        let Self { members: members @ 1.., steps, learning_rate } = *self else { return Ok(None) };
        let fit = Fit { members: members as usize, steps, learning_rate };
        let step = |number| TrainingStep { number, learning_rate: "ensemble.learning_rate" };
        let data = copies.data(model);
        let codes = fits::finite_codes("model", model.encode(&data.images))?;
        let moves = Moves { codes: &codes, actions: &data.actions, copies: data.copies };
        let fitted = Ensemble::fit(&model.sizes, moves, fit, rng);
        Ok(Some(fitted.map_err(|number| step(number).diverged("a weight of the ensemble is not finite"))?))
    }
}
