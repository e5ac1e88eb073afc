//! Logical time: the round, epoch and step of a message. It holds no wall clock.
//!
//! In a recording, round `r` is day `r` after 2000-01-01, and a step is a millisecond of that day. A tool that knows only
//! timestamps still shows the messages in order, and the date tells the round. A day holds 86.4 million steps; later
//! steps get the last millisecond of their day, so they never reach the next round.

/// 2000-01-01T00:00:00Z in seconds. The date is too old to be mistaken for the time of a run, and it is not 1970, which
/// looks like a missing time.
const ORIGIN_SECS: u64 = 946_684_800;
const DAY_MILLIS: u64 = 86_400_000;

/// Logical time of a message.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct At {
    /// Round of the loop; 0 outside of a loop.
    pub round: u32,
    /// Epoch within the node.
    pub epoch: u32,
    /// Step within the node. It never decreases.
    pub step: u64,
}

impl At {
    /// The time at a step of an epoch of a round.
    pub fn new(round: u32, epoch: u32, step: u64) -> Self {
        Self { round, epoch, step }
    }

    /// The time as MCAP stores it: nanoseconds since 1970.
    pub(super) fn log_time(self) -> u64 {
        let millis = u64::from(self.round) * DAY_MILLIS + self.step.min(DAY_MILLIS - 1);
        // A round above 200,000 exceeds u64. The time then stays at its maximum, and does not wrap around.
        (ORIGIN_SECS * 1000).saturating_add(millis).saturating_mul(1_000_000)
    }

    /// The time as protobuf messages store it.
    pub(super) fn timestamp(self) -> prost_types::Timestamp {
        let nanos = self.log_time();
        prost_types::Timestamp { seconds: (nanos / 1_000_000_000) as i64, nanos: (nanos % 1_000_000_000) as i32 }
    }
}

#[cfg(test)]
mod tests {
    use super::At;

    #[test]
    fn a_later_round_is_later_whatever_the_step() {
        assert!(At::new(0, 0, u64::MAX).log_time() < At::new(1, 0, 0).log_time());
        assert!(At::new(3, 0, 7).log_time() < At::new(3, 0, 8).log_time());
        assert!(At::new(u32::MAX, 0, 0).log_time() >= At::new(100_000, 0, 0).log_time());
    }
}
