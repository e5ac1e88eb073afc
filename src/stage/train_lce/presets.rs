//! The presets of `train_lce`, and what its parameters need.

use serde::Deserialize;

use super::{
    TrainLce, checks,
    params::{LossName, Params, UNBOUNDED},
};
use crate::{
    control::guidance::Guidance,
    stage::{self, Preset, PresetOf, Refusal, Stage as _},
};

impl stage::Params for Params {
    fn preset(of: &PresetOf<'_>) -> Self {
        let mut params = Self { objective: given(of, "objective", LossName::Carl), ..Self::default() };
        if params.objective == LossName::Pcc {
            params.lambda.prior = params.lambda.encode_decode;
        }
        if of.preset == Preset::Paper {
            // The paper has no warm-up, ramp, anchor or restart. Of L_reg it says only that its weight is small.
            (params.warm_up_epochs, params.ramp_epochs, params.lambda.anchor) = (0, 0, 0.0);
            params.restarts = 0;
            params.lambda.regularizer = if params.objective == LossName::Pcc { 0.0 } else { 0.01 };
            params.guidance = Guidance { bound: UNBOUNDED, normalize: false, ..params.guidance };
        }
        of.lay_task_over(TrainLce::KIND, params)
    }

    fn check(&self) -> Vec<Refusal> {
        checks::out_of_range(self)
    }

    fn needs(&self) -> &'static [&'static str] {
        if self.objective == LossName::ValueGuided { &["warm_start", "value"] } else { &[] }
    }
}

/// The choice that the file writes for a parameter, or else `usual`. Other defaults depend on it.
fn given<'a, T: Deserialize<'a>>(of: &PresetOf<'a>, name: &str, usual: T) -> T {
    of.given.get(name).and_then(|named| T::deserialize(named).ok()).unwrap_or(usual)
}
