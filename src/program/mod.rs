//! Runs a program of the user as a child process. Nothing that it starts outlives its node or this process.
//!
//! The program leads a life in a process group with a *guard*: a shell that waits for the end of a pipe which this
//! process holds. Whatever ends this process, a SIGKILL too, closes the pipe, and the guard kills the group. Processes
//! that left the group are found by a mark in their environment.

#![allow(clippy::disallowed_methods, reason = "a time limit reads a clock; no result holds a time")]

mod guard;
mod lines;
mod processes;

use std::{
    env, io,
    os::unix::process::{CommandExt as _, ExitStatusExt as _},
    path::{Path, PathBuf},
    process::{Child, Command, ExitStatus, Stdio},
    sync::mpsc::{Receiver, RecvTimeoutError},
    time::{Duration, Instant},
};

use rustix::process::Signal;

use guard::Guard;
pub use lines::{Line, Source};
pub use processes::Process;

/// The descriptor on which a program writes events.
pub const EVENTS: u32 = 3;
/// How long a program that is asked to stop may take to clean up.
const GRACE: Duration = Duration::from_secs(5);
/// How long processes that a program started may outlive it.
const LINGER: Duration = Duration::from_secs(1);
/// How often the state of the program is looked at.
const TICK: Duration = Duration::from_millis(10);

/// What to run.
#[derive(Debug)]
pub struct Launch<'a> {
    /// The program and its arguments.
    pub argv: &'a [String],
    /// All variables of its environment. One of them must be nobody else's: it marks what the program starts.
    pub variables: &'a [(String, String)],
    /// The variable among them that marks its processes.
    pub mark: &'a str,
    /// The folder that it runs in.
    pub folder: &'a Path,
    /// The longest time that it may take.
    pub limit: Option<Duration>,
}

/// How a program ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum End {
    /// By itself, with this exit status.
    Exit(i32),
    /// By a signal that somebody else sent.
    Signal(i32),
    /// It took longer than its limit and was killed.
    TimedOut,
    /// The caller stopped it.
    Stopped,
    /// It ended with exit status 0 but left processes running, which were killed.
    LeftBehind(Vec<Process>),
}

/// What the caller of [`run`] says to each tick and line.
pub trait Watch {
    /// Whether the program should stop.
    fn stop_asked(&mut self) -> bool;
    /// Takes a line that the program wrote.
    ///
    /// # Errors
    /// The program is killed, and [`run`] returns this error.
    fn line(&mut self, line: Line) -> anyhow::Result<()>;
}

/// Runs a program to its end. All its processes are gone when this returns.
///
/// # Errors
/// The program cannot be started, or the watch refused a line.
pub fn run(launch: &Launch<'_>, watch: &mut dyn Watch) -> anyhow::Result<End> {
    let program = found(&launch.argv[0], launch)?;
    let guard = Guard::start(launch.mark)?;
    let (child, lines) = start(launch, &program, &guard)?;
    let mut running = Running { child, guard: &guard, mark: launch.mark };
    let ended = running.watch(launch.limit, &lines, watch);
    let left = running.end_all(matches!(ended, Ok(Some(_))));
    // Every writer is gone, so the readers reach the end of their pipes.
    let rest = drain(&lines, watch);
    let end = match ended? {
        Some(status) => of_status(status, left),
        None if watch.stop_asked() => End::Stopped,
        None => End::TimedOut,
    };
    rest?;
    Ok(end)
}

fn of_status(status: ExitStatus, left: Vec<Process>) -> End {
    match (status.code(), status.signal()) {
        (Some(0), _) if !left.is_empty() => End::LeftBehind(left),
        (Some(code), _) => End::Exit(code),
        (None, signal) => End::Signal(signal.unwrap_or_default()),
    }
}

/// The program's path, looked up in `PATH` unless it names a folder.
fn found(name: &str, launch: &Launch<'_>) -> anyhow::Result<PathBuf> {
    if name.contains('/') {
        let path = launch.folder.join(name);
        anyhow::ensure!(path.exists(), "there is no program `{name}`");
        return Ok(path);
    }
    let path = launch.variables.iter().find(|(variable, _)| variable == "PATH").map(|(_, value)| value.as_str());
    let mut places = env::split_paths(path.unwrap_or_default()).map(|folder| folder.join(name));
    places.find(|place| place.is_file()).ok_or_else(|| anyhow::anyhow!("there is no program `{name}` in `PATH`"))
}

/// Starts the program. A shell gives it the pipe of its events as descriptor 3, and then becomes the program.
fn start(launch: &Launch<'_>, program: &Path, guard: &Guard) -> anyhow::Result<(Child, Receiver<Line>)> {
    let (events, to_events) = io::pipe()?;
    let mut command = Command::new("/bin/sh");
    command.args(["-c", "exec 3>&0 </dev/null; exec \"$@\"", "carl-pipe"]).arg(program).args(&launch.argv[1..]);
    command.env_clear().envs(launch.variables.iter().map(|(name, value)| (name, value)));
    command.current_dir(launch.folder).process_group(guard.group());
    command.stdin(Stdio::from(to_events)).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().map_err(|error| anyhow::anyhow!("cannot start `{}`: {error}", launch.argv[0]))?;
    // The command holds the writing end of the pipe of events.
    drop(command);
    let (stdout, stderr) = (child.stdout.take().expect("a pipe"), child.stderr.take().expect("a pipe"));
    Ok((child, lines::read_all(stdout, stderr, events)))
}

/// A program at work.
struct Running<'a> {
    child: Child,
    guard: &'a Guard,
    mark: &'a str,
}

impl Running<'_> {
    /// Waits until the program ends, and returns its exit status; `None` if it was stopped or took too long.
    fn watch(
        &mut self,
        limit: Option<Duration>,
        lines: &Receiver<Line>,
        watch: &mut dyn Watch,
    ) -> anyhow::Result<Option<ExitStatus>> {
        let start = Instant::now();
        loop {
            // A program that writes without end must not keep the loop from looking at the clock.
            for _ in 0..1000 {
                match lines.recv_timeout(TICK) {
                    Ok(line) => watch.line(line)?,
                    Err(RecvTimeoutError::Timeout) => break,
                    Err(RecvTimeoutError::Disconnected) => {
                        std::thread::sleep(TICK);
                        break;
                    }
                }
            }
            if let Some(status) = self.child.try_wait()? {
                return Ok(Some(status));
            }
            if watch.stop_asked() || limit.is_some_and(|limit| start.elapsed() >= limit) {
                self.ask_to_end()?;
                return Ok(None);
            }
        }
    }

    /// Asks the group to end, and waits a little for the program.
    fn ask_to_end(&mut self) -> io::Result<()> {
        self.guard.signal(Signal::TERM);
        let deadline = Instant::now() + GRACE;
        while self.child.try_wait()?.is_none() && Instant::now() < deadline {
            std::thread::sleep(TICK);
        }
        Ok(())
    }

    /// Kills all processes of the program, and returns those that outlived it. After an end by itself they get a
    /// moment to end too.
    fn end_all(&mut self, by_itself: bool) -> Vec<Process> {
        let patience = if by_itself { LINGER } else { Duration::ZERO };
        let deadline = Instant::now() + patience;
        let mut left = self.others();
        while !left.is_empty() && Instant::now() < deadline {
            std::thread::sleep(TICK);
            left = self.others();
        }
        let mut more = left.clone();
        while !more.is_empty() {
            more.iter().for_each(Process::kill);
            std::thread::sleep(Duration::from_millis(1));
            more = self.others();
        }
        _ = self.child.kill();
        _ = self.child.wait();
        left
    }

    /// The living processes of the program except the program itself, unless that is alive too.
    fn others(&self) -> Vec<Process> {
        processes::of(self.guard.group(), self.guard.pid(), self.mark)
    }
}

/// Hands on the lines that are left.
fn drain(lines: &Receiver<Line>, watch: &mut dyn Watch) -> anyhow::Result<()> {
    let deadline = Instant::now() + LINGER;
    while let Ok(line) = lines.recv_timeout(deadline.saturating_duration_since(Instant::now())) {
        watch.line(line)?;
    }
    Ok(())
}
