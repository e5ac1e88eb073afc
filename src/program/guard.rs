//! The process that kills the processes of a program once this process is gone.

use std::{
    env, io,
    os::unix::process::CommandExt as _,
    process::{Child, Command, Stdio},
};

use rustix::process::{Pid, Signal, kill_process_group};

/// What the guard does: it waits for a line or the end of its input. Then it kills the processes with the mark, which
/// are those that left the group too, and the group, which is itself too. It looks for marks twice, since a process may
/// start another one meanwhile.
const SCRIPT: &str = r#"
trap '' TERM INT HUP
read -r _
for turn in 1 2; do
    for file in $(grep -lsaF "$0" /proc/[0-9]*/environ); do
        pid=${file#/proc/}
        kill -KILL "${pid%/environ}"
    done
done
kill -KILL 0
"#;

/// A guard at work. Dropping it ends the guard and every process of its group.
#[derive(Debug)]
pub(super) struct Guard {
    child: Child,
}

impl Guard {
    /// Starts a guard as the leader of a new process group.
    pub(super) fn start(mark: &str) -> io::Result<Self> {
        let mut command = Command::new("/bin/sh");
        command.args(["-c", SCRIPT, mark]).process_group(0).env_clear();
        command.envs(env::var_os("PATH").map(|path| ("PATH", path)));
        command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::null());
        Ok(Self { child: command.spawn()? })
    }

    /// The number of the process group.
    pub(super) fn group(&self) -> i32 {
        self.child.id() as i32
    }

    /// The guard's own number.
    pub(super) fn pid(&self) -> u32 {
        self.child.id()
    }

    /// Sends a signal to the group. The guard itself only heeds SIGKILL.
    pub(super) fn signal(&self, signal: Signal) {
        if let Some(group) = Pid::from_raw(self.group()) {
            _ = kill_process_group(group, signal);
        }
    }
}

impl Drop for Guard {
    fn drop(&mut self) {
        self.signal(Signal::KILL);
        _ = self.child.wait();
    }
}
