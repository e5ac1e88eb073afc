//! The processes that hold a file lock, as the kernel lists them.

use std::{fmt, fs, os::unix::fs::MetadataExt as _, path::Path};

/// A process that holds a lock.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Holder {
    /// Its number.
    pub pid: u32,
    /// Whether a signal has stopped it, so that it frees the lock only when it is continued or killed.
    pub is_stopped: bool,
    /// Seconds since it started.
    pub age_secs: u64,
}

impl fmt::Display for Holder {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let age = match self.age_secs {
            secs @ ..120 => format!("{secs} s"),
            secs @ 120..7200 => format!("{} min", secs / 60),
            secs => format!("{} h", secs / 3600),
        };
        write!(f, "process {} (started {age} ago", self.pid)?;
        if self.is_stopped {
            write!(f, ", stopped; `kill -CONT {}` continues it", self.pid)?;
        }
        f.write_str(")")
    }
}

/// The processes that hold a lock on a file; none where the system does not tell.
pub(super) fn holders(path: &Path) -> Vec<Holder> {
    let Ok(meta) = fs::metadata(path) else { return Vec::new() };
    // The kernel writes `1: FLOCK ADVISORY WRITE 3215 fe:00:10502164 0 EOF`: pid, and the file by device and inode.
    let file = format!("{:02x}:{:02x}:{}", major(meta.dev()), minor(meta.dev()), meta.ino());
    let list = fs::read_to_string("/proc/locks").unwrap_or_default();
    let pid = |line: &str| {
        let words: Vec<&str> = line.split_whitespace().collect();
        // A process that waits for the lock has `->` as its second word.
        let is_it = words.get(1) == Some(&"FLOCK") && words.get(5) == Some(&file.as_str());
        is_it.then(|| words[4].parse().ok()).flatten()
    };
    let mut pids: Vec<u32> = list.lines().filter_map(pid).collect();
    pids.sort_unstable();
    pids.dedup();
    pids.into_iter().filter_map(of_process).collect()
}

fn major(device: u64) -> u64 {
    (device >> 8 & 0xfff) | (device >> 32 & !0xfff)
}

fn minor(device: u64) -> u64 {
    (device & 0xff) | (device >> 12 & !0xff)
}

fn of_process(pid: u32) -> Option<Holder> {
    let text = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    // The name of the program, in parentheses, may hold spaces.
    let words: Vec<&str> = text.rsplit_once(')')?.1.split_whitespace().collect();
    let ticks: u64 = words.get(19)?.parse().ok()?;
    let uptime: f64 = fs::read_to_string("/proc/uptime").ok()?.split_whitespace().next()?.parse().ok()?;
    // Linux counts start times in hundredths of a second on every machine that we support.
    let age_secs = (uptime as u64).saturating_sub(ticks / 100);
    Some(Holder { pid, is_stopped: matches!(*words.first()?, "T" | "t"), age_secs })
}
