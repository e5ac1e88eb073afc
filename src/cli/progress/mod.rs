//! Shows the progress of a run on standard error: bars on a terminal, lines elsewhere.

mod bars;
mod lines;
mod message;

use std::{io::IsTerminal as _, time::Duration};

use super::{
    Global,
    out::{self, duration},
    stop::Stop,
};
use crate::{run::events::Listener, stage::Kind};
use bars::Bars;
use lines::Lines;
use message::Messages;

/// How to show progress.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum How {
    /// `Bar` on a terminal, `None` with `--json`, `Plain` otherwise.
    Auto,
    /// A bar for each node that runs.
    Bar,
    /// A line for each node that runs.
    Plain,
    /// Only warnings.
    None,
}

impl How {
    /// Replaces `Auto` by the display that fits the terminal and the other options.
    pub(crate) fn resolve(self, json: bool, quiet: bool) -> Self {
        match self {
            Self::Auto if quiet => Self::None,
            Self::Auto if draws_bars() => Self::Bar,
            // Where bars cannot be drawn, warnings must still be seen.
            Self::Bar if !draws_bars() => Self::Plain,
            Self::Auto if json => Self::None,
            Self::Auto => Self::Plain,
            how => how,
        }
    }
}

/// Whether standard error is a terminal that can move its cursor.
fn draws_bars() -> bool {
    let is_dumb = std::env::var_os("TERM").is_none_or(|term| term == "dumb");
    std::io::stderr().is_terminal() && !is_dumb
}

/// A display of progress.
pub(crate) trait Progress: Listener {
    /// Removes bars from the terminal.
    fn close(&self);
}

/// The display that was asked for.
pub(crate) fn new(how: How, global: &Global, kinds: &[Kind], stop: Stop) -> Box<dyn Progress> {
    let headlines = kinds.iter().filter_map(|kind| kind.headline).collect();
    let messages = Messages { headlines, verbose: global.verbose };
    match how {
        How::Bar => Box::new(Bars::new(messages, stop)),
        How::None => Box::new(Lines::only_warnings(messages)),
        How::Plain | How::Auto => Box::new(Lines::new(messages)),
    }
}

/// Rate and remaining time, such as `  (3.1/s, 2 min 10 s left)`; empty before the first step and after the last.
fn time_left(done: u64, total: u64, spent: Duration) -> String {
    if done == 0 || total <= done {
        return String::new();
    }
    let rate = done as f64 / spent.as_secs_f64().max(1e-9);
    format!("  ({}/s, {} left)", out::number(rate), duration((total - done) as f64 / rate))
}
