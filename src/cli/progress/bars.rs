//! Progress as bars on a terminal.

use std::{
    collections::BTreeMap,
    fmt,
    sync::{Mutex, MutexGuard, PoisonError},
    time::Duration,
};

use indicatif::{MultiProgress, ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};

use super::{Progress, message::Messages};
use crate::{
    cli::{out, stop::Stop},
    diag::visible,
    run::events::{Event, Listener},
};

/// Draws a bar for each node that runs, and one for the run.
pub(super) struct Bars {
    messages: Messages,
    stop: Stop,
    all: MultiProgress,
    state: Mutex<BarState>,
}

struct BarState {
    /// The bar of the run, on the last line: how many nodes have ended.
    whole: ProgressBar,
    running: BTreeMap<String, ProgressBar>,
    has_announced_stop: bool,
}

impl Bars {
    pub(super) fn new(messages: Messages, stop: Stop) -> Self {
        let all = MultiProgress::with_draw_target(ProgressDrawTarget::stderr_with_hz(10));
        let state = BarState { whole: ProgressBar::hidden(), running: BTreeMap::new(), has_announced_stop: false };
        Self { messages, stop, all, state: Mutex::new(state) }
    }

    fn state(&self) -> MutexGuard<'_, BarState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn begin(&self, nodes: u64) {
        let whole = self.all.add(ProgressBar::new(nodes));
        whole.set_style(style("{bar} {pos}/{len} nodes  {elapsed} {wide_msg}"));
        whole.enable_steady_tick(Duration::from_millis(250));
        self.state().whole = whole;
    }

    fn start(&self, node: &str) {
        let mut state = self.state();
        let bar = self.all.insert_before(&state.whole, ProgressBar::new(0));
        bar.set_style(style("  {prefix} {spinner} {elapsed} {wide_msg}"));
        bar.set_prefix(visible(node).into_owned());
        bar.enable_steady_tick(Duration::from_millis(250));
        state.running.insert(node.to_owned(), bar);
    }

    fn progress(&self, node: &str, done: u64, total: u64, note: &str) {
        let mut state = self.state();
        if let Some(bar) = state.running.get(node) {
            if bar.length() != Some(total) {
                bar.set_length(total);
                bar.set_style(style("  {prefix} {bar} {pos}/{len}  {rate}  {eta} left  {wide_msg}"));
            }
            bar.set_position(done);
            bar.set_message(visible(note).into_owned());
        }
        if self.stop.is_asked() && !state.has_announced_stop {
            state.has_announced_stop = true;
            state.whole.set_message("stopping at the next step; Ctrl-C again stops now".to_owned());
        }
    }
}

/// A style by its template, in which `{bar}` is coloured where colours are wanted.
fn style(template: &str) -> ProgressStyle {
    let bar = if out::stderr_has_colours() { "{bar:24.cyan/dim}" } else { "{bar:24}" };
    let style =
        ProgressStyle::with_template(&template.replace("{bar}", bar)).unwrap_or_else(|_| ProgressStyle::default_bar());
    let rate = |state: &ProgressState, text: &mut dyn fmt::Write| {
        let _ = write!(text, "{}/s", out::number(state.per_sec()));
    };
    style.with_key("rate", rate).progress_chars("━╸─")
}

impl Listener for Bars {
    fn on_event(&self, event: &Event) {
        let nodes = self.state().whole.length().unwrap_or_default() as usize;
        if let Some(text) = self.messages.of(event, self.messages.detail(nodes)) {
            let _ = self.all.println(out::for_stderr(&text));
        }
        match event {
            Event::RunStarted { nodes, .. } => self.begin(*nodes as u64),
            Event::NodeStarted { node, .. } => self.start(node),
            Event::Progress { node, done, total, note } => self.progress(node, *done, *total, note),
            Event::NodeFinished { node, .. } => {
                let mut state = self.state();
                if let Some(bar) = state.running.remove(node) {
                    bar.finish_and_clear();
                    self.all.remove(&bar);
                }
                state.whole.inc(1);
            }
            _ => {}
        }
    }
}

impl Progress for Bars {
    fn close(&self) {
        self.state().whole.finish_and_clear();
        let _ = self.all.clear();
    }
}
