//! The presets of `train_lce`, and what its parameters need.

use super::{
    TrainLce, checks,
    params::{Lambda, LossName, Params, UNBOUNDED},
};
use crate::{
    control::guidance::Guidance,
    lce::pc3::Pc3,
    stage::{
        self, Preset, PresetOf, Refusal, Stage as _, StepScale,
        StepScale::{Grows, Shrinks},
        Symmetries,
    },
};

impl Lambda {
    /// The weights of an objective's own terms, and the anchor.
    pub(super) fn of(objective: &LossName) -> Self {
        let carl = Self::default();
        match objective {
            LossName::Carl | LossName::ValueGuided(_) => carl,
            LossName::Pcc => Self { prior: carl.encode_decode, ..carl },
            LossName::Pc3(_) => Self {
                consistency: 1.0,
                curvature: 7.0,
                encode_decode: 0.0,
                prediction: 0.0,
                deterministic: 0.0,
                ..carl
            },
            LossName::Rce => Self {
                prediction: 1.0,
                consistency: 1.0,
                encode_decode: 0.0,
                curvature: 0.0,
                deterministic: 0.0,
                ..carl
            },
            LossName::E2c => Self {
                encode_decode: 1.0,
                prior: 1.0,
                prediction: 1.0,
                consistency: 0.25,
                curvature: 0.0,
                deterministic: 0.0,
                ..carl
            },
        }
    }
}

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
        Grows("objective.pc3.nce"),
        Grows("objective.pc3.center"),
    ];

    fn preset(of: &PresetOf<'_>) -> Self {
        let objective = match of.chosen("objective") {
            Some("value_guided") => LossName::ValueGuided(Guidance::default()),
            Some("pcc") => LossName::Pcc,
            Some("pc3") => LossName::Pc3(Pc3::default()),
            Some("e2c") => LossName::E2c,
            Some("rce") => LossName::Rce,
            _ => LossName::Carl,
        };
        let mut params = Self { objective, ..Self::default() };
        params.lambda = Lambda::of(&params.objective);
        if of.preset == Preset::Paper {
            // The paper has no warm-up, ramp, anchor or restart. Of L_reg it says only that its weight is small.
            (params.warm_up.epochs, params.ramp.epochs, params.lambda.anchor) = (0, 0, 0.0);
            params.restarts = 0;
            if matches!(params.objective, LossName::Carl | LossName::ValueGuided(_)) {
                params.lambda.regularizer = 0.01;
            }
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
