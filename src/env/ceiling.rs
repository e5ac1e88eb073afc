//! What the best possible controller reaches, and under which protocol that was measured.
//!
//! The figures are with their dynamics in [`Environment::ceiling_as`]; they hold for the environment's own goals and
//! radius, counting T+1 states. A result under another protocol has no share of them.

use super::{Environment, Start, Task};

/// A protocol of evaluation, as far as it can differ.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Protocol {
    /// Largest distance from the goal that counts as being there.
    pub radius: f64,
    /// Where episodes start.
    pub start: Start,
}

impl Protocol {
    /// The one under which the ceiling of these starts was measured.
    pub fn of_ceiling(env: &dyn Environment, start: Start) -> Self {
        Self { radius: env.goal_radius(), start }
    }
}

impl Task {
    /// Mean %-goal of the best possible controller under this protocol; `None` where nobody has measured it.
    pub fn ceiling(&self, protocol: Protocol) -> Option<f64> {
        let env = self.open();
        env.ceiling_as(protocol.start).filter(|_| protocol == Protocol::of_ceiling(&*env, protocol.start))
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_ceiling_holds_under_its_own_protocol_alone() {
        let of = |table: serde_json::Value, radius| {
            let task: Task = serde_json::from_value(table).unwrap();
            task.ceiling(Protocol { radius, start: Start::Usual })
        };
        let narrow: Task = serde_json::from_value(json!({"env": "cart_pole"})).unwrap();
        let radius = narrow.open().goal_radius();
        assert_eq!(narrow.ceiling(Protocol { radius, start: Start::Narrow }), Some(100.0));
        assert_eq!(of(json!({"env": "planar"}), 5.0), Some(78.87));
        assert_eq!(of(json!({"env": "planar"}), 2.0), None);
        assert_eq!(of(json!({"env": "planar", "noise": 0.1}), 5.0), None);
    }
}
