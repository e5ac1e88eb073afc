//! A panic is a mistake in this program. A user sees one line about it, not a trace.

use std::panic::{self, PanicHookInfo};

use super::out;

/// Reports panics in one line, with their place. With `RUST_BACKTRACE` they are reported as usual.
pub(super) fn report_in_one_line() {
    if std::env::var_os("RUST_BACKTRACE").is_none() {
        panic::set_hook(Box::new(|info| out::note(&line(info))));
    }
}

fn line(info: &PanicHookInfo<'_>) -> String {
    let place = info.location().map_or_else(String::new, |place| format!(" at {place}"));
    let what = info.payload_as_str().unwrap_or("no message");
    let help = "run it again with RUST_BACKTRACE=1 and report what it prints";
    format!("{} this is a mistake in carl-pipe{place}: {what}\n  = {} {help}", out::red("error:"), out::bold("help:"))
}
