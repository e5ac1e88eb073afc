//! The parameters of `control_solar`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{ControlSolar, rollouts::Group};
use crate::{
    env::{Spec, Start},
    solar::{iteration::Settings, local_dynamics::LocalFit, trainer::ACTION_VARIANCE},
    stage::{PresetOf, Refusal, Stage as _, above_zero, count, one_goal::OneGoal, state_cost::Distance},
};

#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(in crate::stage) struct Params {
    /// Iterations of rollouts and improvement.
    pub(super) iterations: u64,
    /// Rollouts of an iteration, of T steps each. They are divided among the goals.
    pub(super) rollouts: u64,
    /// Standard deviation of the actions in the first iteration, as a share of the limit of an action.
    pub(super) initial_std: f64,
    /// Pseudo-counts of a rollout in the fit of the local dynamics.
    strength: f64,
    /// The most sweeps of the fit of the local dynamics.
    sweeps: u64,
    /// KL bound of the new policy from the old one, per step of an episode.
    kl_step: f64,
    /// Where costs come from.
    pub(super) cost: Cost,
    /// κ, the cost of a squared unit of distance from the goal.
    pub(super) state_cost: f64,
    /// r, the cost of an action, ½ r |a|²; an action's limit is 1.
    action_cost: f64,
    /// The goals that policies are made for.
    goals: Goals,
    /// Where episodes start.
    pub(super) start: Start,
    /// Episodes that measure the mean action at every goal before an iteration. They are no samples: nothing learns from
    /// them.
    pub(super) measured: u64,
}

/// Where the costs of the controller come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(super) enum Cost {
    /// The distance of codes from the code of the goal image.
    GoalImage,
    /// The distance of true states from the goal, to which a convex cost is fitted: more than the other algorithms get. For
    /// an upper baseline.
    TrueState,
}

/// The goals that policies are made for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(super) enum Goals {
    /// Every goal has a policy of its own, made with its share of the rollouts.
    Known,
    /// One policy for all goals, which does not know the goal of its episode.
    Blind,
    /// One policy, for one goal.
    Only(OneGoal),
}

impl Default for Params {
    fn default() -> Self {
        Self {
            iterations: 10,
            rollouts: 40,
            initial_std: 0.5,
            strength: 50.0,
            sweeps: 100,
            kl_step: 2.0,
            cost: Cost::GoalImage,
            state_cost: 50.0,
            action_cost: 1.0,
            goals: Goals::Known,
            start: Start::Usual,
            measured: 1,
        }
    }
}

impl crate::stage::Params for Params {
    fn preset(of: &PresetOf<'_>) -> Self {
        of.lay_task_over(ControlSolar::KIND, Self::default())
    }

    fn check(&self) -> Vec<Refusal> {
        let mut refusals = Vec::new();
        for (path, value, fewest, most) in [
            ("iterations", self.iterations, 1, 10_000),
            ("rollouts", self.rollouts, 1, 10_000),
            ("sweeps", self.sweeps, 1, 1_000_000),
            ("measured", self.measured, 1, 10_000),
        ] {
            count(&mut refusals, path, value, fewest..=most);
        }
        for (path, value) in [
            ("initial_std", self.initial_std),
            ("strength", self.strength),
            ("kl_step", self.kl_step),
            ("state_cost", self.state_cost),
            ("action_cost", self.action_cost),
        ] {
            above_zero(&mut refusals, path, value);
        }
        refusals
    }
}

/// A change of the objective below this ends a fit of local dynamics.
const TOLERANCE: f64 = 1e-3;

impl Params {
    pub(super) fn distance(&self) -> Distance {
        Distance { state_cost: self.state_cost, action_cost: self.action_cost }
    }

    pub(super) fn settings(&self) -> Settings {
        let fit = LocalFit {
            strength: self.strength,
            action_variance: ACTION_VARIANCE,
            tolerance: TOLERANCE,
            sweeps: self.sweeps,
        };
        Settings { fit, kl_step: self.kl_step, action_cost: self.action_cost }
    }

    /// The groups of goals that share a policy.
    pub(super) fn groups(&self, spec: &Spec) -> anyhow::Result<Vec<Group>> {
        let all = || 0..spec.goals;
        let groups: Vec<Group> = match self.goals {
            Goals::Known => all().map(|goal| Group { goals: vec![goal] }).collect(),
            Goals::Blind => vec![Group { goals: all().collect() }],
            Goals::Only(goal) => vec![Group { goals: vec![goal.number(spec.goals)?] }],
        };
        let (rollouts, count) = (self.rollouts, groups.len());
        anyhow::ensure!(rollouts >= count as u64, "{rollouts} rollouts for {count} goals: raise `rollouts`");
        Ok(groups)
    }
}
