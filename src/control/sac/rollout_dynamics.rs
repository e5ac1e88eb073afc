//! The dynamics of latent rollouts: the model's F, or an ensemble.

use std::ops::Range;

use crate::lce::{Ensemble, LceModel, dynamics::Dynamics};

/// One network F or several. Each follows its share of a batch.
#[derive(Debug)]
pub(super) struct RolloutDynamics<'a> {
    /// The layers of each member.
    pub(super) net: Dynamics,
    /// The parameters of each member.
    pub(super) members: Vec<&'a [f32]>,
}

impl<'a> RolloutDynamics<'a> {
    /// The F of a model.
    pub(super) fn of_model(model: &'a LceModel) -> Self {
        Self { net: model.nets.dynamics, members: vec![&model.arena] }
    }

    /// The members of an ensemble.
    pub(super) fn of_ensemble(ensemble: &'a Ensemble) -> Self {
        Self { net: ensemble.net, members: ensemble.members.iter().map(Vec::as_slice).collect() }
    }

    /// Which of `samples` samples each member follows.
    pub(super) fn shares(&self, samples: usize) -> impl Iterator<Item = Range<usize>> {
        let count = self.members.len();
        (0..count).map(move |member| member * samples / count..(member + 1) * samples / count)
    }
}
