//! The lines of JSON by which a program reports while it works.

use serde::Deserialize;

use crate::{
    record::{At, Level},
    stage::StageCx,
};

/// The most curves that a program may record.
const MOST_CURVES: usize = 256;

/// A line on the descriptor of events.
#[derive(Debug, Deserialize)]
#[serde(untagged, deny_unknown_fields)]
enum Event {
    /// A metric of the node. The last value counts.
    Metric { metric: String, value: f64 },
    /// A point of a curve in the recording.
    Scalar {
        scalar: String,
        value: f64,
        #[serde(default)]
        step: u64,
    },
    /// Progress.
    Progress {
        progress: u64,
        of: u64,
        #[serde(default)]
        note: String,
    },
    /// A sentence for the user.
    Say { say: String },
}

/// Takes in the events of a program.
#[derive(Debug, Default)]
pub(super) struct Events {
    lines: u64,
    curves: Vec<String>,
    /// The last progress, which is shown again with each line that the program prints.
    pub(super) progress: (u64, u64),
}

impl Events {
    /// Takes in one line.
    ///
    /// # Errors
    /// The line is no event.
    pub(super) fn take(&mut self, line: &str, cx: &mut StageCx<'_>) -> anyhow::Result<()> {
        self.lines += 1;
        let number = self.lines;
        let no_event = |why: &str| anyhow::anyhow!("line {number} of its events is no event: {why}: `{line}`");
        let event = serde_json::from_str(line).map_err(|_| {
            no_event(
                "write {\"metric\": NAME, \"value\": x}, {\"scalar\": NAME, \"value\": x, \"step\": n}, \
                 {\"progress\": n, \"of\": n} or {\"say\": TEXT}",
            )
        })?;
        match event {
            Event::Metric { metric, .. } | Event::Scalar { scalar: metric, .. } if !is_name(&metric) => {
                return Err(no_event("a name has at most 64 letters, digits, `_`, `-`, `.` and `/`"));
            }
            Event::Metric { metric, value } => cx.metric(&metric, value),
            Event::Scalar { scalar, value, step } => {
                if !self.curves.contains(&scalar) {
                    self.curves.push(scalar.clone());
                }
                if self.curves.len() > MOST_CURVES {
                    return Err(no_event("there are too many curves"));
                }
                cx.record.scalars(&format!("/program/{scalar}"), At::new(cx.round, 0, step), &[("value", value)]);
            }
            Event::Progress { progress, of, note } => {
                self.progress = (progress, of);
                cx.progress(progress, of, &note)?;
            }
            Event::Say { say } => cx.log(At::new(cx.round, 0, number), Level::Info, &say),
        }
        Ok(())
    }
}

/// Whether a text can name a metric or a curve.
fn is_name(text: &str) -> bool {
    let fits = |letter: u8| letter.is_ascii_alphanumeric() || b"_-./".contains(&letter);
    (1..=64).contains(&text.len()) && text.bytes().all(fits)
}
