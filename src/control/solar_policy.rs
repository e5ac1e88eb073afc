//! SOLAR as a policy: it filters the pictures and actions so far, and acts on the filtered mean.

use super::{
    agent_policy::Acting,
    policy::{Goal, Moment, Policy},
};
use crate::{
    lce::{LceModel, PreparedEncoder},
    num::{rng::Rng, sampling},
    solar::{Small, controller::Plan, filter::Filter, model::FLOOR, objective::add_potentials},
};

/// The plans of a controller at work.
#[derive(Debug)]
pub struct SolarPolicy<'a> {
    encoder: PreparedEncoder<'a>,
    networks: &'a LceModel,
    plans: &'a [Plan],
    acting: Acting,
    goal: usize,
    filter: Option<Filter>,
    /// The potentials of this episode: the diagonals of J, and h.
    seen: (Vec<f64>, Vec<f64>),
}

impl<'a> SolarPolicy<'a> {
    /// Acts by a plan for every goal, or by one for all.
    pub fn new(networks: &'a LceModel, plans: &'a [Plan], acting: Acting) -> Self {
        let encoder = PreparedEncoder::new(networks, 1);
        Self { encoder, networks, plans, acting, goal: 0, filter: None, seen: (Vec::new(), Vec::new()) }
    }

    /// The potentials of the pictures that the policy saw in this episode: the diagonals of J, and h.
    pub fn seen(&self) -> (&[f64], &[f64]) {
        (&self.seen.0, &self.seen.1)
    }

    /// The filtered mean, given the picture now; zero where it is not finite.
    fn filtered(&mut self, moment: &Moment<'_>) -> Small {
        let d = self.networks.sizes.latent;
        let plan = &self.plans[if self.plans.len() == 1 { 0 } else { self.goal }];
        let before = self.filter.take().zip(moment.last_action);
        let advanced = before.and_then(|(mut filter, action)| {
            let action: Vec<f64> = action.iter().map(|&a| f64::from(a)).collect();
            let transition = (moment.step - 1).min(plan.dynamics.len() - 1);
            filter.advance(&plan.dynamics[transition], &action).map(|()| filter)
        });
        let mut filter = advanced.unwrap_or_else(|| Filter::new(d));
        let codes = self.encoder.codes(&self.networks.pictures(moment.observation));
        let (precision, linear) = &mut self.seen;
        add_potentials(&codes, d, FLOOR, precision, linear);
        filter.observe(&precision[precision.len() - d..], &linear[linear.len() - d..]);
        let mean = filter.moments().map(|(mean, _)| mean);
        self.filter = Some(filter);
        mean.unwrap_or_else(|| Small::zeros(d, 1))
    }
}

impl Policy for SolarPolicy<'_> {
    fn begin(&mut self, goal: Goal<'_>, _: Rng) {
        self.goal = goal.index;
        self.filter = None;
        self.seen.0.clear();
        self.seen.1.clear();
    }

    /// Draws the noise of a sample also where the mean acts, so that both draw the same from the stream.
    fn act(&mut self, moment: &Moment<'_>, rng: &mut Rng) -> Vec<f32> {
        let z = self.filtered(moment);
        let mut noise = vec![0.0; self.networks.sizes.action];
        sampling::fill_normal(rng, &mut noise);
        let noise = (self.acting == Acting::Sample).then(|| Small::column(&noise));
        let plan = &self.plans[if self.plans.len() == 1 { 0 } else { self.goal }];
        plan.policy.action(moment.step, &z, noise.as_ref()).iter().map(|a| a.clamp(-1.0, 1.0) as f32).collect()
    }
}
