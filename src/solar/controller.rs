//! What SOLAR acts with: the encoder, and a policy with the dynamics that its filter uses, for every goal.

use super::{LinearGaussianPolicy, mniw::Expected};
use crate::lce::LceModel;

/// A policy and the expected statistics of the dynamics of every transition, or one for all.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// The policy.
    pub policy: LinearGaussianPolicy,
    /// E t of the dynamics that the policy was planned with.
    pub dynamics: Vec<Expected>,
}

/// A controller from pictures.
#[derive(Debug, Clone, PartialEq)]
pub struct SolarController {
    /// Its encoder sees.
    pub networks: LceModel,
    /// One plan for every goal, or one for all.
    pub plans: Vec<Plan>,
}

impl SolarController {
    /// The plan of a goal.
    pub fn plan(&self, goal: usize) -> &Plan {
        &self.plans[if self.plans.len() == 1 { 0 } else { goal }]
    }
}
