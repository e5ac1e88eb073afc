//! The presets of `train_lce`, and what its parameters need.

use super::{
    TrainLce, checks,
    params::{LossName, Params, UNBOUNDED},
};
use crate::{
    control::guidance::Guidance,
    stage::{
        self, Preset, PresetOf, Refusal, Stage as _, StepScale,
        StepScale::{Grows, Shrinks},
        Symmetries,
    },
};

impl stage::Params for Params {
    const STEP_SCALES: &'static [StepScale] = &[
        Grows("learning_rate"),
        Grows("warm_up.learning_rate"),
        Grows("weight_decay"),
        Grows("lambda.encode_decode"),
        Grows("lambda.prior"),
        Grows("lambda.prediction"),
        Grows("lambda.consistency"),
        Grows("lambda.curvature"),
        Grows("lambda.regularizer"),
        Grows("lambda.deterministic"),
        Grows("lambda.anchor"),
        Grows("curvature_sigma"),
        Grows("warm_up.loss.scale"),
        Grows("warm_up.loss.anchor"),
        Grows("warm_up.loss.shrink"),
        Shrinks("warm_up.loss.sigma"),
        Grows("objective.value_guided.temperature"),
        Grows("objective.value_guided.bound"),
    ];

    fn preset(of: &PresetOf<'_>) -> Self {
        let objective = match of.chosen("objective") {
            Some("value_guided") => LossName::ValueGuided(Guidance::default()),
            Some("pcc") => LossName::Pcc,
            _ => LossName::Carl,
        };
        let mut params = Self { objective, ..Self::default() };
        if params.objective == LossName::Pcc {
            params.lambda.prior = params.lambda.encode_decode;
        }
        if of.preset == Preset::Paper {
            // The paper has no warm-up, ramp, anchor or restart. Of L_reg it says only that its weight is small.
            (params.warm_up.epochs, params.ramp.epochs, params.lambda.anchor) = (0, 0, 0.0);
            params.restarts = 0;
            params.lambda.regularizer = if params.objective == LossName::Pcc { 0.0 } else { 0.01 };
            if let LossName::ValueGuided(guidance) = &mut params.objective {
                (guidance.bound, guidance.normalize) = (UNBOUNDED, false);
            }
        }
        of.lay_task_over(TrainLce::KIND, params)
    }

    fn check(&self) -> Vec<Refusal> {
        checks::out_of_range(self)
    }

    fn symmetries(&self) -> Option<&Symmetries> {
        Some(&self.symmetries)
    }

    fn needs(&self) -> &'static [&'static str] {
        if matches!(self.objective, LossName::ValueGuided(_)) { &["warm_start", "value"] } else { &[] }
    }
}
