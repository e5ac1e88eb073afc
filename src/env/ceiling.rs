//! The protocol under which a ceiling holds.
//!
//! Ceilings are declared in the files of the tasks, for the task's own goals and radius. A result under another protocol
//! is not a share of them.

use super::{Start, Task};

/// A protocol of evaluation, as far as protocols differ.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Protocol {
    /// Largest distance from the goal that counts as being there.
    pub radius: f64,
    /// Where episodes start.
    pub start: Start,
}

impl Task {
    /// Mean %-goal of the best controller known under this protocol; `None` where it was not measured.
    pub fn ceiling(&self, protocol: Protocol) -> Option<f64> {
        self.ceiling_of(protocol.start).filter(|_| protocol.radius == self.spec().goal_radius)
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_ceiling_holds_only_under_its_own_protocol() {
        let of = |table: serde_json::Value, radius| {
            let task: Task = serde_json::from_value(table).unwrap();
            task.ceiling(Protocol { radius, start: Start::Usual })
        };
        let cart_pole: Task = serde_json::from_value(json!({"env": "cart_pole"})).unwrap();
        let radius = cart_pole.spec().goal_radius;
        assert_eq!(cart_pole.ceiling(Protocol { radius, start: Start::Narrow }), Some(100.0));
        assert_eq!(of(json!({"env": "planar"}), 5.0), Some(78.87));
        assert_eq!(of(json!({"env": "planar"}), 2.0), None);
        assert_eq!(of(json!({"env": "planar", "noise": 0.1}), 5.0), None);
    }
}
