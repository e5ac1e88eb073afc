//! The weighted loss that the parameters of `train_lce` give at one step.

use super::params::Params;
use crate::lce::{
    e2c::E2cLoss,
    objective::{Regularizer, Weights},
    pc3::{Pc3, Pc3Loss},
    rce::RceLoss,
    trainer::Objective,
    warm_up::WarmUp,
};

impl Params {
    /// The share of the consistency weight `step` steps after the warm-up. It grows linearly over the first `ramp` steps.
    pub(super) fn ramp_at(&self, step: u64, ramp: u64) -> f64 {
        let done = if ramp == 0 { 1.0 } else { (step as f64 / ramp as f64).min(1.0) };
        self.ramp.from + (1.0 - self.ramp.from) * done
    }

    /// The loss of CARL or PCC, with this share of the consistency weight.
    pub(super) fn objective_at<'a>(
        &self,
        share: f64,
        regularizer: Option<Regularizer<'a, f32>>,
        guidance: Option<&'a [f32]>,
    ) -> Objective<'a, f32> {
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
                anchor: self.anchor_weight(),
            },
            curvature_sigma: self.curvature_sigma,
            anchor_scale: warm_up.scale,
            guidance,
            regularizer,
        }
    }

    /// The loss of PC3, with this share of the consistency weight.
    pub(super) fn pc3_at(&self, pc3: &Pc3, share: f64) -> Pc3Loss {
        Pc3Loss {
            nce: pc3.nce,
            consistency: self.lambda.consistency * share,
            curvature: self.lambda.curvature,
            center: pc3.center,
            anchor: self.anchor_weight(),
            sigma: pc3.sigma,
            curvature_sigma: self.curvature_sigma,
            anchor_scale: self.warm_up.loss.scale,
        }
    }

    /// The loss of E2C, with this share of the consistency weight.
    pub(super) fn e2c_at(&self, share: f64) -> E2cLoss {
        let lambda = &self.lambda;
        E2cLoss {
            encode_decode: lambda.encode_decode,
            prediction: lambda.prediction,
            prior: lambda.prior,
            transition_kl: lambda.consistency * share,
            anchor: self.anchor_weight(),
            anchor_scale: self.warm_up.loss.scale,
        }
    }

    /// The loss of RCE, with this share of the consistency weight.
    pub(super) fn rce_at(&self, share: f64) -> RceLoss {
        RceLoss {
            reconstruction: self.lambda.prediction,
            consistency: self.lambda.consistency * share,
            anchor: self.anchor_weight(),
            anchor_scale: self.warm_up.loss.scale,
        }
    }

    /// The weight of the squared anchor. The warm-up's anchor is in units of its sigma.
    fn anchor_weight(&self) -> f64 {
        let WarmUp { sigma, .. } = self.warm_up.loss;
        self.lambda.anchor * 0.5 / (sigma * sigma)
    }
}
