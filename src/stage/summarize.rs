//! Statistics over the evaluations of several models, such as `evaluate@last[*]`, the last round of every seed.
//!
//! The unit is one model with its mean over its episodes; intervals are percentile bootstraps that resample models. The
//! stage refuses evaluations under different protocols, because their mean would mean nothing.

use anyhow::{Context as _, ensure};

use super::{NoParams, Stage, StageCx, inputs};
use crate::{
    artifact::{Evaluation, MetricSummary, ResultSummary},
    env::Protocol,
    num::stats::Summary,
};

inputs! {
    pub(super) struct Inputs {
        /// one evaluation of each model: `evaluate@last[*]` is the last round at every point of the matrix
        evaluations: Vec<Evaluation>,
    }
}

fn protocol(evaluation: &Evaluation) -> Protocol {
    Protocol { radius: evaluation.radius, start: evaluation.start }
}

pub(super) struct Summarize;

impl Stage for Summarize {
    const KIND: &'static str = "summarize";
    const VERSION: u32 = 1;
    const ABOUT: &'static str = "mean, standard error, bootstrap interval, best and worst over models";
    type Params = NoParams;
    type Inputs = Inputs;
    type Output = ResultSummary;

    fn run(_: &NoParams, inputs: Inputs, cx: &mut StageCx<'_>) -> anyhow::Result<ResultSummary> {
        let all = inputs.evaluations;
        let first = all.first().context("there is no evaluation")?;
        for other in &all {
            let same =
                (first.controller, first.unstick, first.horizon) == (other.controller, other.unstick, other.horizon);
            ensure!(
                same && protocol(first) == protocol(other),
                "evaluations under different protocols have no common mean; name evaluations of one task and one controller"
            );
        }
        let metric = |of: fn(&Evaluation) -> f64| {
            let models: Vec<f64> = all.iter().map(of).collect();
            let summary = Summary::of(&models).context("there is no evaluation")?;
            anyhow::Ok(MetricSummary { summary, models })
        };
        let percent_goal = metric(|it| it.percent_goal)?;
        let policy_alone = metric(|it| it.policy_alone)?;
        let ceiling = cx.task.ceiling(protocol(first));
        let mean = percent_goal.summary.mean;
        cx.metric("percent_goal", mean);
        if let Some(error) = percent_goal.summary.standard_error {
            cx.metric("standard_error", error);
        }
        cx.metric("models", percent_goal.summary.n as f64);
        Ok(ResultSummary {
            controller: first.controller,
            radius: first.radius,
            start: first.start,
            horizon: first.horizon,
            episodes: all.iter().map(|it| it.episodes.len()).collect(),
            percent_goal,
            policy_alone,
            percent_goal_t: metric(|it| it.percent_goal_t)?,
            ceiling,
            share_of_ceiling: ceiling.map(|ceiling| 100.0 * mean / ceiling),
        })
    }
}
