//! Shows a run while it happens: bars on a terminal, lines elsewhere.

#![allow(clippy::disallowed_methods, reason = "wall time is shown to people; no result holds it")]

use std::{
    collections::BTreeMap,
    fmt,
    io::IsTerminal as _,
    sync::{Mutex, MutexGuard, PoisonError},
    time::{Duration, Instant},
};

use indicatif::{MultiProgress, ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};

use super::{
    Global,
    out::{self, Paint, duration},
    stop::Stop,
};
use crate::run::events::{Event, Listener, NodeState};

/// How to show progress.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum How {
    /// Bars on a terminal, lines elsewhere; nothing beside `--json`.
    Auto,
    /// A bar for each node that runs.
    Bar,
    /// A line for each node.
    Plain,
    /// Nothing.
    None,
}

impl How {
    pub(crate) fn resolve(self, json: bool, quiet: bool) -> Self {
        match self {
            Self::Auto if quiet => Self::None,
            Self::Auto if std::io::stderr().is_terminal() => Self::Bar,
            Self::Auto if json => Self::None,
            Self::Auto => Self::Plain,
            how => how,
        }
    }
}

/// A listener that leaves the terminal clean.
pub(crate) trait Progress: Listener {
    /// Takes bars away.
    fn close(&self);
}

/// The progress that was asked for.
pub(crate) fn new(how: How, global: &Global, stop: Stop) -> Box<dyn Progress> {
    let (paint, verbose) = (global.color.on_stderr(), global.verbose);
    match how {
        How::Bar => Box::new(Bars::new(paint, verbose, stop)),
        How::None => Box::new(Plain::new(paint, false, true)),
        _ => Box::new(Plain::new(paint, verbose, false)),
    }
}

/// What is worth a line however progress is shown.
fn sentence(event: &Event, paint: Paint, talk: Talk) -> Option<String> {
    let verbose = talk == Talk::Much;
    match event {
        Event::RunStarted { run, pipeline, seed, nodes } => {
            let seed = seed.map_or_else(String::new, |seed| format!(", seed {seed}"));
            Some(format!("{} {pipeline}: {nodes} nodes{seed} {}", paint.bold("run"), paint.dim(&format!("({run})"))))
        }
        Event::Metric { node, round, name, value } if name == "percent_goal" => {
            let (member, bare) = node.split_once('/').map_or(("", node.as_str()), |(member, bare)| (member, bare));
            let stage = bare.split(['@', '[']).next().unwrap_or(bare);
            let place = match round {
                Some(round) if stage == "evaluate" => format!("round {round}"),
                Some(round) => format!("round {round} {stage}"),
                None => stage.to_owned(),
            };
            // At a point of a matrix the round alone would not tell which.
            let point = node.split_once('[').map_or_else(String::new, |(_, point)| format!(" [{point}"));
            let member = if member.is_empty() { String::new() } else { format!("{member} ") };
            Some(format!("{member}{place}{point}  {name} {}", paint.bold(&out::number(*value))))
        }
        Event::Metric { node, name, value, .. } if verbose => Some(format!("{node}  {name} {}", out::number(*value))),
        Event::Say { node, text } => Some(format!("{node}: {text}")),
        Event::Warning { node: Some(node), text } => Some(format!("{} {node}: {text}", paint.yellow("warning:"))),
        Event::Warning { node: None, text } => Some(format!("{} {text}", paint.yellow("warning:"))),
        Event::NodeFinished { node, state, secs, .. } => match state {
            NodeState::Ran if talk == Talk::Little => None,
            NodeState::Ran => Some(format!("{node}  {} in {}", paint.green("ran"), duration(*secs))),
            NodeState::Cached if verbose => Some(format!("{node}  {}", paint.dim("cached"))),
            NodeState::Failed => Some(format!("{node}  {} after {}", paint.red("failed"), duration(*secs))),
            NodeState::Stopped => Some(format!("{node}  {} after {}", paint.yellow("stopped"), duration(*secs))),
            NodeState::Cached | NodeState::Pending => None,
        },
        _ => None,
    }
}

/// How many lines nodes are worth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Talk {
    /// In runs of many nodes: what is reached, and what goes wrong.
    Little,
    /// A line when a node has run.
    Some,
    /// Cached nodes and all metrics too.
    Much,
}

/// Runs of more nodes than this say little about each.
const MANY: usize = 100;

impl Talk {
    fn of(verbose: bool, nodes: usize) -> Self {
        match verbose {
            true => Self::Much,
            false if nodes > MANY => Self::Little,
            false => Self::Some,
        }
    }
}

/// Lines on standard error.
struct Plain {
    paint: Paint,
    verbose: bool,
    only_warnings: bool,
    /// Nodes of the run, those that ended, and when that was last told.
    count: Mutex<(usize, usize, Option<Instant>)>,
    /// When each node began, and when it last had a line.
    spoken: Mutex<BTreeMap<String, (Instant, Instant)>>,
}

/// The least time between two lines about a node.
const LINE_EVERY: Duration = Duration::from_secs(10);

impl Listener for Plain {
    fn on_event(&self, event: &Event) {
        if self.only_warnings && !matches!(event, Event::Warning { .. }) {
            return;
        }
        let talk = self.count(event);
        if let Some(text) = sentence(event, self.paint, talk) {
            out::note(&text);
        }
        let mut spoken = self.spoken.lock().unwrap_or_else(PoisonError::into_inner);
        let now = Instant::now();
        match event {
            Event::NodeStarted { node, .. } => {
                if talk != Talk::Little {
                    out::note(&format!("{node}  started"));
                }
                spoken.insert(node.clone(), (now, now));
            }
            Event::Progress { node, done, total, note } => {
                let Some((began, last)) = spoken.get_mut(node).filter(|(_, last)| last.elapsed() >= LINE_EVERY) else {
                    return;
                };
                *last = now;
                let left = left(*done, *total, began.elapsed());
                out::note(&format!("{node}  {done}/{total}  {note}{left}"));
            }
            _ => {}
        }
    }
}

impl Plain {
    fn new(paint: Paint, verbose: bool, only_warnings: bool) -> Self {
        Self { paint, verbose, only_warnings, count: Mutex::default(), spoken: Mutex::default() }
    }

    /// Counts nodes; tells how many are done now and then where each of them has no line.
    fn count(&self, event: &Event) -> Talk {
        let mut count = self.count.lock().unwrap_or_else(PoisonError::into_inner);
        match event {
            Event::RunStarted { nodes, .. } => *count = (*nodes, 0, Some(Instant::now())),
            Event::NodeFinished { .. } => count.1 += 1,
            _ => {}
        }
        let talk = Talk::of(self.verbose, count.0);
        if talk == Talk::Little && count.2.is_some_and(|last| last.elapsed() >= LINE_EVERY) {
            count.2 = Some(Instant::now());
            out::note(&format!("{} of {} nodes", count.1, count.0));
        }
        talk
    }
}

impl Progress for Plain {
    fn close(&self) {}
}

/// `  (3.1/s, 2 min 10 s left)`.
fn left(done: u64, total: u64, spent: Duration) -> String {
    if done == 0 || total <= done {
        return String::new();
    }
    let rate = done as f64 / spent.as_secs_f64().max(1e-9);
    format!("  ({}/s, {} left)", out::number(rate), duration((total - done) as f64 / rate))
}

/// Bars on standard error.
struct Bars {
    paint: Paint,
    verbose: bool,
    stop: Stop,
    all: MultiProgress,
    state: Mutex<BarState>,
}

struct BarState {
    /// The last line: how many nodes are done.
    whole: ProgressBar,
    running: BTreeMap<String, ProgressBar>,
    has_said_stop: bool,
}

impl Bars {
    fn new(paint: Paint, verbose: bool, stop: Stop) -> Self {
        let all = MultiProgress::with_draw_target(ProgressDrawTarget::stderr_with_hz(10));
        let state = BarState { whole: ProgressBar::hidden(), running: BTreeMap::new(), has_said_stop: false };
        Self { paint, verbose, stop, all, state: Mutex::new(state) }
    }

    fn state(&self) -> MutexGuard<'_, BarState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn begin(&self, nodes: u64) {
        let whole = self.all.add(ProgressBar::new(nodes));
        whole.set_style(style("{bar:24.cyan/dim} {pos}/{len} nodes  {elapsed} {wide_msg}"));
        whole.enable_steady_tick(Duration::from_millis(250));
        self.state().whole = whole;
    }

    fn start(&self, node: &str) {
        let mut state = self.state();
        let bar = self.all.insert_before(&state.whole, ProgressBar::new(0));
        bar.set_style(style("  {prefix} {spinner} {elapsed} {wide_msg}"));
        bar.set_prefix(node.to_owned());
        bar.enable_steady_tick(Duration::from_millis(250));
        state.running.insert(node.to_owned(), bar);
    }

    fn progress(&self, node: &str, done: u64, total: u64, note: &str) {
        let mut state = self.state();
        if let Some(bar) = state.running.get(node) {
            if bar.length() != Some(total) {
                bar.set_length(total);
                bar.set_style(style("  {prefix} {bar:24.cyan/dim} {pos}/{len}  {rate}  {eta} left  {wide_msg}"));
            }
            bar.set_position(done);
            bar.set_message(note.to_owned());
        }
        if self.stop.is_asked() && !state.has_said_stop {
            state.has_said_stop = true;
            state.whole.set_message("stopping at the next step; Ctrl-C again stops now".to_owned());
        }
    }
}

fn style(template: &str) -> ProgressStyle {
    let style = ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
    let rate = |state: &ProgressState, text: &mut dyn fmt::Write| {
        let _ = write!(text, "{}/s", out::number(state.per_sec()));
    };
    style.with_key("rate", rate).progress_chars("━╸─")
}

impl Listener for Bars {
    fn on_event(&self, event: &Event) {
        let nodes = self.state().whole.length().unwrap_or_default() as usize;
        if let Some(text) = sentence(event, self.paint, Talk::of(self.verbose, nodes)) {
            let _ = self.all.println(text);
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
