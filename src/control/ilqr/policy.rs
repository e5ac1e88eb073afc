//! iLQR as a policy: it plans anew at every step from E(x) towards E(x_g).

use super::{Ilqr, LatentDynamics, Planner};
use crate::{
    control::policy::{Goal, Moment, Policy},
    lce::{LceModel, PreparedEncoder},
    num::rng::Rng,
};

/// iLQR in the latent space of a model.
pub struct IlqrPolicy<'a> {
    model: &'a LceModel,
    encoder: PreparedEncoder<'a>,
    settings: &'a Ilqr,
    planner: Option<Planner<'a, LatentDynamics>>,
}

impl<'a> IlqrPolicy<'a> {
    /// Plans in the dynamics of a model.
    pub fn new(model: &'a LceModel, settings: &'a Ilqr) -> Self {
        Self { model, encoder: PreparedEncoder::new(model, 1), settings, planner: None }
    }

    fn code(&mut self, picture: &[u8]) -> Vec<f64> {
        self.encoder.mean(picture).into_iter().map(f64::from).collect()
    }
}

impl Policy for IlqrPolicy<'_> {
    fn begin(&mut self, goal: Goal<'_>, plans: Rng) {
        let z_goal = self.code(goal.image);
        self.planner = Some(Planner::new(self.settings, LatentDynamics::of(self.model), z_goal, plans));
    }

    fn act(&mut self, moment: &Moment<'_>, _: &mut Rng) -> Vec<f32> {
        let z = self.code(moment.observation);
        let planner = self.planner.as_mut().expect("an episode has begun");
        planner.act(&z, moment.left).into_iter().map(|u| u.clamp(-1.0, 1.0) as f32).collect()
    }
}
