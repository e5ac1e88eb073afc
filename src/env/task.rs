//! The `[task]` table of a pipeline: which environment, and the options of its dynamics, every one explicit.
//!
//! An option that an environment does not know is refused, since it would change nothing.

use serde::{Deserialize, Serialize};

use super::{CartPole, Environment, Planar, SwingUp, ThreePole};

/// The `[task]` table, with the defaults of the environment written out.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(from = "Written")]
pub struct Task {
    /// Which environment.
    pub env: EnvName,
    /// Standard deviation of the process noise, in units of the state.
    pub noise: f64,
    /// Control step in seconds.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub step: Option<f64>,
    /// Largest torque in newton metres.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub torque: Option<f64>,
    /// Links of the arm.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub links: Option<usize>,
}

/// The environments there are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EnvName {
    /// Navigation among obstacles.
    Planar,
    /// Swing-up of a pendulum.
    SwingUp,
    /// Balance of a pole on a cart.
    CartPole,
    /// Swing-up and balance of an arm of three links, or two.
    ThreePole,
}

impl EnvName {
    /// As pipelines write it.
    pub fn word(self) -> &'static str {
        match self {
            Self::Planar => "planar",
            Self::SwingUp => "swing_up",
            Self::CartPole => "cart_pole",
            Self::ThreePole => "three_pole",
        }
    }

    /// The options that an environment knows beside `noise`, with their defaults: control step, torque, links.
    fn options(self) -> (Option<f64>, Option<f64>, Option<usize>) {
        match self {
            Self::Planar => (None, None, None),
            // One of two readings under which the paper's best figure can be reached.
            Self::SwingUp => (Some(0.05), Some(0.65), None),
            // At the public implementation's 0.02 no picture shows what a force did.
            Self::CartPole => (Some(0.05), None, None),
            Self::ThreePole => (Some(0.05), None, Some(3)),
        }
    }
}

/// The table as people write it.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Written {
    env: EnvName,
    #[serde(default)]
    noise: f64,
    step: Option<f64>,
    torque: Option<f64>,
    links: Option<usize>,
}

impl From<Written> for Task {
    fn from(Written { env, noise, step, torque, links }: Written) -> Self {
        let defaults = env.options();
        Self { env, noise, step: step.or(defaults.0), torque: torque.or(defaults.1), links: links.or(defaults.2) }
    }
}

/// An option of the task that cannot be used.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RefusedOption {
    /// Its name.
    pub name: &'static str,
    /// A lower-case clause such as ``must be 0 or above, but is `-1` ``.
    pub why: String,
    /// The next step.
    pub help: Option<String>,
}

impl Task {
    /// The environment with these options, which [`Task::check`] has passed.
    pub fn open(&self) -> Box<dyn Environment> {
        let noise = self.noise;
        match (self.env, self.step, self.torque, self.links) {
            (EnvName::SwingUp, Some(step), Some(torque), _) => Box::new(SwingUp { noise, step, torque }),
            (EnvName::CartPole, Some(step), ..) => Box::new(CartPole { noise, step }),
            (EnvName::ThreePole, Some(step), _, Some(links)) => Box::new(ThreePole { noise, step, links }),
            (EnvName::Planar, ..) => Box::new(Planar { noise }),
            (env, ..) => panic!("the options of `{}` are not written out", env.word()),
        }
    }

    /// Every option that is unknown to the environment or out of range.
    pub fn check(&self) -> Vec<RefusedOption> {
        let (step, torque, links) = self.env.options();
        let written = [
            ("noise", true, Some(self.noise), "0 or above", 0.0..=f64::MAX),
            ("step", step.is_some(), self.step, "between 0.001 and 0.2", 0.001..=0.2),
            ("torque", torque.is_some(), self.torque, "between 0.01 and 100", 0.01..=100.0),
            ("links", links.is_some(), self.links.map(|links| links as f64), "2 or 3", 2.0..=3.0),
        ];
        let known: Vec<String> = written.iter().filter(|it| it.1).map(|it| format!("`{}`", it.0)).collect();
        let refused = written.into_iter().filter_map(|(name, is_known, value, range, within)| {
            let value = value?;
            if !is_known {
                let why = format!("is no option of `{}`", self.env.word());
                let help = Some(format!("it has {}", known.join(", ")));
                return Some(RefusedOption { name, why, help });
            }
            let why = format!("must be {range}, but is `{value}`");
            (!within.contains(&value)).then_some(RefusedOption { name, why, help: None })
        });
        refused.collect()
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn task(table: serde_json::Value) -> Task {
        serde_json::from_value(table).expect("a task")
    }

    #[test]
    fn defaults_are_written_out_and_planar_has_none() {
        let explicit = |table| serde_json::to_value(task(table)).unwrap();
        assert_eq!(explicit(json!({"env": "planar"})), json!({"env": "planar", "noise": 0.0}));
        let swing_up = json!({"env": "swing_up", "noise": 0.0, "step": 0.05, "torque": 0.65});
        assert_eq!(explicit(json!({"env": "swing_up"})), swing_up);
        assert_eq!(explicit(swing_up.clone()), swing_up);
        assert_eq!(explicit(json!({"env": "three_pole", "links": 2}))["links"], 2);
    }

    #[test]
    fn an_option_of_another_task_is_refused() {
        let [refused] = &task(json!({"env": "planar", "torque": 1.0})).check()[..] else { panic!("not one") };
        assert_eq!((refused.name, &*refused.why), ("torque", "is no option of `planar`"));
        assert_eq!(refused.help.as_deref(), Some("it has `noise`"));
    }

    #[test]
    fn options_out_of_range_are_refused_all_at_once() {
        let bad = json!({"env": "swing_up", "noise": -1, "step": 0, "torque": 1e9});
        let told: Vec<_> = task(bad).check().into_iter().map(|it| format!("{} {}", it.name, it.why)).collect();
        assert_eq!(
            told,
            [
                "noise must be 0 or above, but is `-1`",
                "step must be between 0.001 and 0.2, but is `0`",
                "torque must be between 0.01 and 100, but is `1000000000`",
            ]
        );
        assert_eq!(task(json!({"env": "three_pole", "links": 4})).check().len(), 1);
    }

    #[test]
    fn every_environment_opens() {
        for (env, action, frames) in [("planar", 2, 1), ("swing_up", 1, 2), ("cart_pole", 1, 2), ("three_pole", 3, 2)] {
            let task = task(json!({ "env": env }));
            assert!(task.check().is_empty());
            assert_eq!(task.env.word(), env);
            let env = task.open();
            assert_eq!((env.action_limit().len(), env.frames()), (action, frames));
        }
    }
}
