//! Where SOLAR's controller stands between two iterations.

use serde::{Deserialize, Serialize};

use super::Plan;
use crate::{
    artifact::{Files, json, put_plans, take_plans, tensors::read_json},
    solar::{iteration::Progress, mniw::Expected},
    stage::StageState,
};

/// The policies and local dynamics of all groups of goals.
pub(super) struct Control {
    /// Iterations done.
    pub(super) iteration: u64,
    /// The policy of every group.
    pub(super) progress: Vec<Progress>,
    /// The dynamics that each group's filter uses.
    pub(super) dynamics: Vec<Vec<Expected>>,
    /// The percent of time at the goal in the last iteration: of its rollouts, and by mean actions.
    pub(super) percent_goal: [f64; 2],
}

impl Control {
    /// What each group acts with.
    pub(super) fn plans(&self) -> Vec<Plan> {
        let groups = self.progress.iter().zip(&self.dynamics);
        groups
            .map(|(progress, dynamics)| Plan { policy: progress.policy.clone(), dynamics: dynamics.clone() })
            .collect()
    }
}

#[derive(Serialize, Deserialize)]
struct About {
    iteration: u64,
    latent: usize,
    action: usize,
    percent_goal: [f64; 2],
    multipliers: Vec<f64>,
    estimates: Vec<Option<[f64; 2]>>,
}

impl StageState for Control {
    fn save(&self) -> anyhow::Result<Files> {
        let plans = self.plans();
        let about = About {
            iteration: self.iteration,
            latent: plans[0].policy.steps[0].gain.columns(),
            action: plans[0].policy.steps[0].gain.rows(),
            percent_goal: self.percent_goal,
            multipliers: self.progress.iter().map(|progress| progress.multiplier).collect(),
            estimates: self.progress.iter().map(|progress| progress.estimates).collect(),
        };
        Ok(Files::from([("control.json", json(&about)?.into()), ("plans.safetensors", put_plans(&plans)?)]))
    }

    fn load(files: &Files) -> anyhow::Result<Self> {
        let about: About = read_json(files, "control.json")?;
        let plans = take_plans(files, "plans.safetensors", about.latent, about.action)?;
        let numbers = about.multipliers.into_iter().zip(about.estimates);
        anyhow::ensure!(numbers.len() == plans.len(), "policies of different numbers of groups");
        let (mut progress, mut dynamics) = (Vec::new(), Vec::new());
        for (plan, (multiplier, estimates)) in plans.into_iter().zip(numbers) {
            progress.push(Progress { policy: plan.policy, multiplier, estimates });
            dynamics.push(plan.dynamics);
        }
        Ok(Self { iteration: about.iteration, progress, dynamics, percent_goal: about.percent_goal })
    }
}
