//! Divergence of training: a loss or a weight that is not finite ends the stage, with the likely cause.
//!
//! A number that is finite but absurd is no divergence; the checks of the latent map judge what was learned.

use serde_json::Value;

use super::{Params, Preset, PresetOf};
use crate::env::Task;

/// A parameter stands out from this many times its default on.
const STANDS_OUT: f64 = 10.0;

/// A parameter that scales a training step, by its path below the stage, such as `lambda.consistency`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StepScale {
    /// A larger value makes larger steps: learning rates, weights of loss terms.
    Grows(&'static str),
    /// A smaller value makes larger steps: standard deviations that a loss divides by.
    Shrinks(&'static str),
}

/// The error of a training step after which a loss or a weight is not finite.
#[derive(Debug)]
pub struct Diverged {
    /// Counted from 0, as in the recording.
    step: u64,
    what: String,
    /// The path of the step's learning rate, which is named where no parameter stands out.
    learning_rate: &'static str,
    cause: Option<String>,
}

impl std::fmt::Display for Diverged {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "diverged in step {}: {}", self.step, self.what)?;
        self.cause.iter().try_for_each(|cause| write!(f, "; {cause}"))
    }
}

impl std::error::Error for Diverged {}

/// A training step that is done, and what it must not have left.
#[derive(Debug, Clone, Copy)]
pub(super) struct TrainingStep {
    /// Counted from 0, as in the recording.
    pub(super) number: u64,
    /// The path of its learning rate.
    pub(super) learning_rate: &'static str,
}

impl TrainingStep {
    /// Refuses a step with a loss, by the name of its curve, or with weights that are not finite.
    pub(super) fn must_be_finite(self, losses: &[(&str, f64)], are_weights_finite: bool) -> Result<(), Diverged> {
        let what = match losses.iter().find(|(_, loss)| !loss.is_finite()) {
            Some((name, loss)) => format!("`{name}` is {loss}"),
            None if !are_weights_finite => "a weight or a moment of Adam is not finite".to_owned(),
            None => return Ok(()),
        };
        Err(self.diverged(what))
    }

    /// The error of this step.
    pub(super) fn diverged(self, what: impl Into<String>) -> Diverged {
        let Self { number, learning_rate } = self;
        Diverged { step: number, what: what.into(), learning_rate, cause: None }
    }
}

/// Adds the likely cause to an error of a stage, if the stage diverged: the parameter that is furthest from its default,
/// as a factor. `params` are all parameters.
pub(super) fn with_cause<P: Params>(error: anyhow::Error, params: &Value, task: &Task) -> anyhow::Error {
    match error.downcast::<Diverged>() {
        Ok(diverged) => Diverged { cause: Some(cause::<P>(&diverged, params, task)), ..diverged }.into(),
        Err(error) => error,
    }
}

fn cause<P: Params>(diverged: &Diverged, params: &Value, task: &Task) -> String {
    let none = serde_json::Map::new();
    let given = params.as_object().unwrap_or(&none);
    let presets = [Preset::Recipe, Preset::Paper]
        .map(|preset| serde_json::to_value(P::preset(&PresetOf { preset, task, given })).unwrap_or_default());
    let number = |of: &Value, path: &str| of.pointer(&format!("/{}", path.replace('.', "/")))?.as_f64();
    // Of the defaults of the two presets, the one that is nearer to the value.
    let factor_of = |scale: &StepScale| {
        let (StepScale::Grows(path) | StepScale::Shrinks(path)) = *scale;
        let value = number(params, path)?;
        let of_defaults = presets.iter().filter_map(|preset| number(preset, path)).map(|default| {
            // A value above a default of 0 counts as the factor itself.
            let factor = match scale {
                StepScale::Grows(_) if default == 0.0 => value,
                StepScale::Grows(_) => value / default,
                StepScale::Shrinks(_) => default / value,
            };
            (factor, path, value, default)
        });
        of_defaults.min_by(|a, b| a.0.total_cmp(&b.0))
    };
    let furthest = P::STEP_SCALES.iter().filter_map(factor_of).max_by(|a, b| a.0.total_cmp(&b.0));
    match furthest.filter(|(factor, ..)| *factor >= STANDS_OUT) {
        Some((_, path, value, default)) => {
            format!("`{path}` = {} is the likely cause: try {}, its default", short(value), short(default))
        }
        None => {
            let path = diverged.learning_rate;
            let value = number(params, path).map_or_else(String::new, |value| format!(" than {}", short(value)));
            format!("no parameter is far from its default: try a smaller `{path}`{value}")
        }
    }
}

/// A number with an exponent where it is long without.
fn short(value: f64) -> String {
    if value == 0.0 || (1e-4..1e6).contains(&value.abs()) { format!("{value}") } else { format!("{value:e}") }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[derive(Debug, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
    #[serde(default)]
    struct Toy {
        learning_rate: f64,
        weight: f64,
        extra: f64,
        sigma: f64,
    }

    impl Default for Toy {
        fn default() -> Self {
            Self { learning_rate: 0.001, weight: 7.0, extra: 0.0, sigma: 0.3 }
        }
    }

    impl Params for Toy {
        const STEP_SCALES: &'static [StepScale] = &[
            StepScale::Grows("learning_rate"),
            StepScale::Grows("weight"),
            StepScale::Grows("extra"),
            StepScale::Shrinks("sigma"),
            StepScale::Grows("choice.of.another"),
        ];

        fn preset(of: &PresetOf<'_>) -> Self {
            let weight = if of.preset == Preset::Paper { 7e4 } else { 7.0 };
            Self { weight, ..Self::default() }
        }
    }

    fn said(learning_rate: f64, weight: f64, extra: f64, sigma: f64) -> String {
        let params = json!(Toy { learning_rate, weight, extra, sigma });
        let task = serde_json::from_value(json!({ "env": "planar" })).unwrap();
        let step = TrainingStep { number: 17, learning_rate: "learning_rate" };
        let error = step.must_be_finite(&[("a", 1.0), ("b", f64::NAN)], true).unwrap_err();
        let text = format!("{:#}", with_cause::<Toy>(error.into(), &params, &task));
        text.strip_prefix("diverged in step 17: `b` is NaN; ").unwrap().to_owned()
    }

    #[test]
    fn the_cause_is_the_parameter_that_is_furthest_from_its_default() {
        let cause = |named: &str, default: &str| format!("`{named} is the likely cause: try {default}, its default");
        assert_eq!(said(1e6, 7e5, 1e3, 0.3), cause("learning_rate` = 1e6", "0.001"));
        assert_eq!(said(0.02, 7e6, 0.0, 0.3), cause("weight` = 7e6", "70000"));
        assert_eq!(said(0.001, 7.0, 50.0, 0.3), cause("extra` = 50", "0"));
        assert_eq!(said(0.02, 70.0, 5.0, 1e-30), cause("sigma` = 1e-30", "0.3"));
        let none =
            |rate: &str| format!("no parameter is far from its default: try a smaller `learning_rate` than {rate}");
        assert_eq!(said(0.001, 7.0, 0.0, 0.3), none("0.001"));
        assert_eq!(said(0.005, 7e4, 0.0, 3e9), none("0.005"), "the weight is the default of the other preset");
    }

    #[test]
    fn a_step_is_refused_for_losses_first_and_other_errors_keep_their_type() {
        let step = TrainingStep { number: 0, learning_rate: "learning_rate" };
        assert!(step.must_be_finite(&[("a", f64::MAX)], true).is_ok());
        let told = |losses: &[(&str, f64)]| step.must_be_finite(losses, false).unwrap_err().to_string();
        assert_eq!(told(&[("a", 1.0), ("b", f64::NEG_INFINITY)]), "diverged in step 0: `b` is -inf");
        assert_eq!(told(&[("a", 1.0)]), "diverged in step 0: a weight or a moment of Adam is not finite");
        let task = serde_json::from_value(json!({ "env": "planar" })).unwrap();
        let error = with_cause::<Toy>(crate::stage::Interrupted.into(), &json!({}), &task);
        assert!(error.is::<crate::stage::Interrupted>());
    }
}
