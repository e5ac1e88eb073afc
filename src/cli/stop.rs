//! Ctrl-C: the first stops at the next step, the second stops at once.

use std::{
    fs,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
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
    /// Listens for SIGINT, SIGTERM and SIGHUP. A second signal ends the process at once. A signal that the process was
    /// told to ignore at its start, as `nohup` does with SIGHUP, stays ignored.
    ///
    /// # Errors
    /// If the handlers cannot be installed.
    pub fn listen() -> anyhow::Result<Self> {
        let stop = Self { flag: Arc::default() };
        let ignored = ignored_signals();
        for signal in [SIGINT, SIGTERM, SIGHUP].into_iter().filter(|signal| ignored & (1 << (signal - 1)) == 0) {
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

/// The signals that this process ignores, as a set of bits: bit 0 for signal 1. Empty where the system does not tell.
fn ignored_signals() -> u64 {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0)
}
