//! iLQR, the controller of PCC. This stage learns nothing: it hands on the settings, and the evaluation has the model.

use super::{PresetOf, Refusal, Stage, StageCx, above_zero, count, inputs};
use crate::control::Ilqr;

impl super::Params for Ilqr {
    fn preset(of: &PresetOf<'_>) -> Self {
        of.lay_task_over(ControlIlqr::KIND, Self::default())
    }

    fn check(&self) -> Vec<Refusal> {
        let mut refusals = Vec::new();
        above_zero(&mut refusals, "state_cost", self.state_cost);
        above_zero(&mut refusals, "action_cost", self.action_cost);
        for (path, value, fewest) in [
            ("plan_length", self.plan_length, 1),
            ("uniform_plans", self.uniform_plans, 0),
            ("bang_bang_plans", self.bang_bang_plans, 0),
            ("iterations", self.iterations, 1),
        ] {
            count(&mut refusals, path, value, fewest..=1000);
        }
        if self.uniform_plans == 0 && self.bang_bang_plans == 0 {
            refusals.push(Refusal::new("uniform_plans", "must be at least 1 where `bang_bang_plans` is 0"));
        }
        refusals
    }
}

inputs! {
    pub(super) struct Inputs {}
}

pub(super) struct ControlIlqr;

impl Stage for ControlIlqr {
    const KIND: &'static str = "control_ilqr";
    /// 2: the settings say whether plans keep within limits.
    const VERSION: u32 = 2;
    const ABOUT: &'static str = "iLQR, the controller of PCC: it plans in a model and learns nothing";
    type Params = Ilqr;
    type Inputs = Inputs;
    type Output = Ilqr;

    fn run(params: &Ilqr, _: Inputs, _: &mut StageCx<'_>) -> anyhow::Result<Ilqr> {
        Ok(params.clone())
    }
}
