//! SOLAR's controller: iterations of rollouts on the filtered mean, local dynamics, and a trust-region LQR.
//!
//! One stage does all iterations and records each of them, because an iteration keeps only the policy, the local dynamics
//! and two estimates of the cost from the one before it.

mod params;
mod rollouts;
mod state;

use anyhow::Context as _;

use params::{Cost, Params};
use rollouts::{Group, Runner};
use state::Control;

use super::{Stage, StageCx, inputs, state_cost::Observer};
use crate::{
    env::Spec,
    record::{At, topic},
    solar::{
        LinearGaussianPolicy, Small, SolarModel,
        chain::chain,
        controller::{Plan, SolarController},
        cost_fit::StateCost,
        iteration::{Costs, Progress, Report},
        mniw::Expected,
    },
};

inputs! {
    pub(super) struct Inputs {
        /// the encoder to see with, and the prior of the local dynamics
        model: SolarModel,
    }
}

pub(super) struct ControlSolar;

impl Stage for ControlSolar {
    const KIND: &'static str = "control_solar";
    const VERSION: u32 = 1;
    const ABOUT: &'static str = "SOLAR's controller: local dynamics and a trust-region LQR, from new rollouts";
    type Params = Params;
    type Inputs = Inputs;
    type Output = SolarController;

    fn run(params: &Params, inputs: Inputs, cx: &mut StageCx<'_>) -> anyhow::Result<SolarController> {
        let (model, spec) = (inputs.model, cx.task.spec());
        fits(&model, &spec)?;
        let groups = params.groups(&spec)?;
        let mut control = cx.resume_or(|| first(params, &model, &spec, groups.len()))?;
        let sizes = &model.networks.sizes;
        let mut chain = chain(sizes.latent, sizes.action, spec.horizon);
        let observer = match params.cost {
            Cost::GoalImage => None,
            Cost::TrueState => Some(Observer::new(cx.task, params.distance())?),
        };
        let mut runner = Runner::new(params, &model, observer.as_ref(), cx)?;
        let samples = params.rollouts as usize * spec.horizon * params.iterations as usize;
        while control.iteration < params.iterations {
            let (iteration, plans) = (control.iteration, control.plans());
            let measured = runner.measure(&groups, &plans, iteration, cx)?;
            let all = runner.roll_out(&groups, &plans, iteration, cx)?;
            let mut reports = Vec::new();
            for (group, (rollouts, progress)) in all.iter().zip(&mut control.progress).enumerate() {
                let to_goal = goal_cost(params, &model, &groups[group], &runner.goal_images);
                let costs = match params.cost {
                    Cost::GoalImage => Costs::Known(&to_goal),
                    Cost::TrueState => Costs::Observed(&rollouts.costs),
                };
                let settings = params.settings();
                let report = progress.improve(&rollouts.rollouts, &model.dynamics, costs, &settings, &mut *chain);
                let report = report.with_context(|| not_finite(iteration))?;
                control.dynamics[group].clone_from(&report.local.expected);
                runner.record_map(&report.local.means, rollouts, &groups, cx.record, At::new(cx.round, 0, iteration));
                reports.push(report);
            }
            let noisy = all.iter().map(|group| group.percent_goal).sum::<f64>() / all.len() as f64;
            let multiplier = control.progress.iter().map(|progress| progress.multiplier).sum::<f64>();
            record(cx, iteration, &reports, multiplier / reports.len() as f64, [noisy, measured]);
            control.percent_goal = [noisy, measured];
            control.iteration += 1;
            let note = format!("{noisy:.0} % with noise, {measured:.0} % without");
            cx.tick(control.iteration, params.iterations, &note, &control)?;
        }
        cx.metric("samples", samples as f64);
        cx.metric("last_percent_goal_noisy", control.percent_goal[0]);
        cx.metric("last_percent_goal_mean", control.percent_goal[1]);
        let plans = control.plans();
        Ok(SolarController { networks: model.networks, plans })
    }
}

fn not_finite(iteration: u64) -> String {
    format!("iteration {iteration} gives numbers that are not finite: lower `kl_step`, or train the model for longer")
}

/// Refuses a model of another task, or of episodes of another length.
fn fits(model: &SolarModel, spec: &Spec) -> anyhow::Result<()> {
    let (sizes, transitions) = (&model.networks.sizes, model.dynamics.len());
    anyhow::ensure!(
        sizes.action == spec.action_limit.len() && sizes.pixels == spec.frames.count * spec.frames.pixels(),
        "the model of input `model` belongs to another task"
    );
    anyhow::ensure!(
        transitions == 1 || transitions + 1 == spec.horizon,
        "the model of input `model` has dynamics for {transitions} transitions; an episode has {}",
        spec.horizon - 1
    );
    Ok(())
}

/// Before the first iteration: random actions, filtered by the global dynamics.
fn first(params: &Params, model: &SolarModel, spec: &Spec, groups: usize) -> anyhow::Result<Control> {
    let expected = model.dynamics.iter().map(|natural| natural.mniw()?.expected());
    let expected: Option<Vec<Expected>> = expected.collect();
    let expected = expected.context("the dynamics of input `model` are not positive definite")?;
    let std = vec![params.initial_std; spec.action_limit.len()];
    let policy = LinearGaussianPolicy::random(spec.horizon, model.networks.sizes.latent, &std);
    let (progress, dynamics) = (vec![Progress::new(policy); groups], vec![expected; groups]);
    Ok(Control { iteration: 0, progress, dynamics, percent_goal: [0.0; 2] })
}

/// The cost of a group's goals: the distance to the mean of their codes, which differs from the mean of the distances by
/// a constant alone.
fn goal_cost(params: &Params, model: &SolarModel, group: &Group, images: &[Vec<u8>]) -> StateCost {
    let d = model.networks.sizes.latent;
    let mut mean = Small::zeros(d, 1);
    for &goal in &group.goals {
        let code = model.networks.encode_means(&model.networks.pictures(&images[goal]));
        let code: Vec<f64> = code.iter().map(|&z| f64::from(z)).collect();
        mean = mean.plus(1.0 / group.goals.len() as f64, &Small::column(&code));
    }
    StateCost::distance(params.state_cost, &mean)
}

/// Records an iteration. Where there are several groups, it records their means.
fn record(cx: &mut StageCx<'_>, iteration: u64, reports: &[Report], multiplier: f64, [noisy, mean]: [f64; 2]) {
    let mean_of = |of: fn(&Report) -> f64| reports.iter().map(of).sum::<f64>() / reports.len() as f64;
    let mut curves = vec![
        ("local_objective", mean_of(|report| report.objective)),
        ("sweeps", mean_of(|report| report.sweeps as f64)),
        ("eta", mean_of(|report| report.eta)),
        ("kl_share", mean_of(|report| report.kl_share)),
        ("multiplier", multiplier),
        ("predicted_improvement", mean_of(|report| report.predicted)),
        ("percent_goal_noisy", noisy),
        ("percent_goal_mean", mean),
    ];
    let actual: Option<Vec<f64>> = reports.iter().map(|report| report.actual).collect();
    curves.extend(actual.map(|all| ("actual_improvement", all.iter().sum::<f64>() / all.len() as f64)));
    cx.record.scalars(topic::CONTROL_SOLAR, At::new(cx.round, 0, iteration), &curves);
}
