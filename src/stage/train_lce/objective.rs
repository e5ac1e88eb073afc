//! The weighted loss that the parameters of `train_lce` give at one step.

use super::params::Params;
use crate::lce::{
    objective::{Regularizer, Weights},
    trainer::Objective,
};

impl Params {
    /// The loss `step` steps after the warm-up. Over the first `ramp` steps the weight of consistency grows linearly.
    pub(super) fn objective_at<'a>(
        &self,
        step: u64,
        ramp: u64,
        regularizer: Option<Regularizer<'a, f32>>,
        guidance: Option<&'a [f32]>,
    ) -> Objective<'a, f32> {
        let done = if ramp == 0 { 1.0 } else { (step as f64 / ramp as f64).min(1.0) };
        let share = self.ramp.from + (1.0 - self.ramp.from) * done;
        let (lambda, warm_up) = (&self.lambda, &self.warm_up.loss);
        Objective {
            weights: Weights {
                reconstruction: lambda.prediction,
                consistency: (lambda.prediction + lambda.consistency) * share,
                curvature: lambda.curvature,
                encode_decode: lambda.encode_decode,
                prior: lambda.prior,
                deterministic: lambda.deterministic,
                regularizer: if regularizer.is_some() { lambda.regularizer } else { 0.0 },
                anchor: lambda.anchor * 0.5 / (warm_up.sigma * warm_up.sigma),
            },
            curvature_sigma: self.curvature_sigma,
            anchor_scale: warm_up.scale,
            guidance,
            regularizer,
        }
    }
}
