//! The processes that belong to a program, as `/proc` lists them.

use std::{fmt, fs, path::Path};

use rustix::process::{Pid, Signal, kill_process};

/// A process.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Process {
    /// Its number.
    pub pid: u32,
    /// Its name, which the system cuts at 15 bytes.
    pub name: String,
}

impl fmt::Display for Process {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "process {} (`{}`)", self.pid, self.name)
    }
}

impl Process {
    /// Ends it.
    pub(super) fn kill(&self) {
        if let Some(pid) = Pid::from_raw(self.pid as i32) {
            _ = kill_process(pid, Signal::KILL);
        }
    }
}

/// The living processes that are in a group or have the mark in their environment, except one.
pub(super) fn of(group: i32, except: u32, mark: &str) -> Vec<Process> {
    let items = fs::read_dir("/proc").into_iter().flatten().flatten();
    let pids = items.filter_map(|item| item.file_name().to_str()?.parse().ok());
    pids.filter(|&pid| pid != except).filter_map(|pid: u32| belonging(pid, group, mark)).collect()
}

fn belonging(pid: u32, group: i32, mark: &str) -> Option<Process> {
    let folder = Path::new("/proc").join(pid.to_string());
    // `12 (name) S 1 12 …`: state, parent and group follow the name, which may hold parentheses and spaces.
    let stat = fs::read(folder.join("stat")).ok()?;
    let stat = String::from_utf8_lossy(&stat);
    let (head, tail) = stat.rsplit_once(')')?;
    let mut words = tail.split_whitespace();
    let is_dead = matches!(words.next()?, "Z" | "X");
    let is_member = words.nth(1)?.parse() == Ok(group);
    let has_mark = || {
        let environment = fs::read(folder.join("environ")).unwrap_or_default();
        environment.windows(mark.len()).any(|window| window == mark.as_bytes())
    };
    if is_dead || !(is_member || has_mark()) {
        return None;
    }
    Some(Process { pid, name: head.split_once('(')?.1.to_owned() })
}
