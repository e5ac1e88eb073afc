//! Ctrl-C: the first stops at the next step, the second stops at once.

use std::sync::{
    Arc,
    atomic::{AtomicBool, Ordering},
};

use anyhow::Context as _;
use signal_hook::{
    consts::{SIGHUP, SIGINT, SIGTERM},
    flag,
};

/// True once a signal has asked the program to stop.
#[derive(Debug, Clone)]
pub struct Stop {
    pub(crate) flag: Arc<AtomicBool>,
}

impl Stop {
    /// Listens for SIGINT, SIGTERM and SIGHUP. A second signal ends the process at once.
    ///
    /// # Errors
    /// If the handlers cannot be installed.
    pub fn listen() -> anyhow::Result<Self> {
        let stop = Self { flag: Arc::default() };
        for signal in [SIGINT, SIGTERM, SIGHUP] {
            // The order matters: a second signal finds the flag that the first one set, and ends the process.
            flag::register_conditional_shutdown(signal, 128 + signal, stop.flag.clone())
                .and_then(|_| flag::register(signal, stop.flag.clone()))
                .context("cannot listen for Ctrl-C")?;
        }
        Ok(stop)
    }

    /// True if a signal has arrived.
    pub fn is_asked(&self) -> bool {
        self.flag.load(Ordering::Relaxed)
    }
}
