//! Progress as lines on standard error.

#![allow(clippy::disallowed_methods, reason = "wall time is shown to people; no result holds it")]

use std::{
    collections::BTreeMap,
    sync::{Mutex, PoisonError},
    time::{Duration, Instant},
};

use super::{
    Progress,
    message::{Detail, Messages},
    time_left,
};
use crate::{
    cli::out,
    run::events::{Event, Listener},
};

/// The least time between two lines about the progress of a node, or of the run.
const LINE_EVERY: Duration = Duration::from_secs(10);

/// Prints lines.
pub(super) struct Lines {
    messages: Messages,
    only_warnings: bool,
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    /// The number of nodes of the run.
    nodes: usize,
    /// The number of nodes that ended.
    ended: usize,
    /// When the last line about the whole run was printed.
    last_count: Option<Instant>,
    /// The nodes that run.
    running: BTreeMap<String, Times>,
}

/// When a node started, and when the last line about it was printed.
struct Times {
    start: Instant,
    last_line: Instant,
}

impl Lines {
    pub(super) fn new(messages: Messages) -> Self {
        Self { messages, only_warnings: false, state: Mutex::default() }
    }

    pub(super) fn only_warnings(messages: Messages) -> Self {
        Self { only_warnings: true, ..Self::new(messages) }
    }
}

impl Listener for Lines {
    fn on_event(&self, event: &Event) {
        if self.only_warnings && !matches!(event, Event::Warning { .. }) {
            return;
        }
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        state.count(event);
        let detail = self.messages.detail(state.nodes);
        if detail == Detail::Low {
            state.print_count();
        }
        if let Some(text) = self.messages.of(event, detail) {
            out::note(&text);
        }
        match event {
            Event::NodeStarted { node, .. } => {
                if detail != Detail::Low {
                    out::note(&format!("{node}  started"));
                }
                let now = Instant::now();
                state.running.insert(node.clone(), Times { start: now, last_line: now });
            }
            Event::Progress { node, done, total, note } => {
                let Some(times) = state.running.get_mut(node).filter(|it| it.last_line.elapsed() >= LINE_EVERY) else {
                    return;
                };
                times.last_line = Instant::now();
                let left = time_left(*done, *total, times.start.elapsed());
                out::note(&format!("{node}  {done}/{total}  {note}{left}"));
            }
            _ => {}
        }
    }
}

impl State {
    fn count(&mut self, event: &Event) {
        match event {
            Event::RunStarted { nodes, .. } => {
                (self.nodes, self.ended, self.last_count) = (*nodes, 0, Some(Instant::now()));
            }
            Event::NodeFinished { .. } => self.ended += 1,
            _ => {}
        }
    }

    /// Prints how many nodes have ended, if the last such line is old enough.
    fn print_count(&mut self) {
        if self.last_count.is_some_and(|last| last.elapsed() >= LINE_EVERY) {
            self.last_count = Some(Instant::now());
            out::note(&format!("{} of {} nodes", self.ended, self.nodes));
        }
    }
}

impl Progress for Lines {
    fn close(&self) {}
}
