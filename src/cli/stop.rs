//! Ctrl-C: once to stop at the next tick, twice to stop now.

use std::sync::{
    Arc,
    atomic::{AtomicBool, Ordering},
};

use anyhow::Context as _;
use signal_hook::{
    consts::{SIGHUP, SIGINT, SIGTERM},
    flag,
};

/// What was asked for by signal.
#[derive(Debug, Clone)]
pub(crate) struct Stop {
    pub(crate) flag: Arc<AtomicBool>,
}

impl Stop {
    /// Hears signals from now on.
    pub(crate) fn listen() -> anyhow::Result<Self> {
        let stop = Self { flag: Arc::default() };
        for signal in [SIGINT, SIGTERM, SIGHUP] {
            // The order matters: the second signal finds the flag set by the first and ends the process.
            flag::register_conditional_shutdown(signal, 128 + signal, stop.flag.clone())
                .and_then(|_| flag::register(signal, stop.flag.clone()))
                .context("cannot listen for Ctrl-C")?;
        }
        Ok(stop)
    }

    pub(crate) fn is_asked(&self) -> bool {
        self.flag.load(Ordering::Relaxed)
    }
}
