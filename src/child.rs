//! A program that runs beside this process: in a process group of its own, and never longer than this process.
//!
//! The kernel kills the program when the thread that started it ends. Whatever the program started itself is in its group,
//! and dies when the value of type [`Child`] is dropped.

#![allow(clippy::disallowed_methods, reason = "a deadline says when an answer is too late; no result holds a time")]

use std::{
    collections::VecDeque,
    io::{self, BufRead as _, Read as _, Write as _},
    os::{fd::AsFd, unix::process::CommandExt as _},
    path::Path,
    process::{ChildStderr, ChildStdin, ChildStdout, Command, ExitStatus, Stdio},
    sync::{Arc, Mutex, MutexGuard, PoisonError, mpsc},
    time::{Duration, Instant},
};

use rustix::{
    event::{PollFd, PollFlags, Timespec, poll},
    process::{Pid, Signal, getpid, getppid, kill_process_group, set_parent_process_death_signal},
};

/// What a pipe that is ready for writing takes at once (`PIPE_BUF`).
const PIECE: usize = 4096;
/// The longest line of standard error that is kept, in bytes.
const LONGEST_LINE: u64 = 2000;
/// Lines of standard error that are kept until somebody takes them, and at the end.
const MOST_LINES: usize = 500;
/// Lines that the error of a dead program shows.
const SHOWN_LINES: usize = 12;
/// How long the last words of a program that has ended may take to arrive.
const LAST_WORDS: Duration = Duration::from_millis(300);

/// A running program.
#[derive(Debug)]
pub struct Child {
    process: std::process::Child,
    stdin: ChildStdin,
    stdout: ChildStdout,
    log: Log,
    /// Ends when standard error is closed.
    log_end: mpsc::Receiver<()>,
}

/// Why nothing could be written or read.
#[derive(Debug)]
pub enum Silence {
    /// The program closed the pipe, as it does when it ends.
    Closed,
    /// The deadline has passed.
    Late,
    /// The system refused.
    System(io::Error),
}

impl Child {
    /// Starts a program in a folder. The lines of its standard error go to `log`.
    ///
    /// # Errors
    /// The system cannot start it.
    pub fn start(command: &[String], folder: &Path, log: Log) -> io::Result<Self> {
        let mut words = command.iter();
        let program = words.next().ok_or(io::ErrorKind::InvalidInput)?;
        let mut command = Command::new(program);
        command.args(words).current_dir(folder).process_group(0);
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        die_with_this_process(&mut command);
        let mut process = command.spawn()?;
        let taken = (process.stdin.take(), process.stdout.take(), process.stderr.take());
        let (Some(stdin), Some(stdout), Some(stderr)) = taken else { unreachable!("all three are pipes") };
        let (sender, log_end) = mpsc::channel();
        let kept = log.clone();
        std::thread::Builder::new().name("stderr".to_owned()).spawn(move || {
            kept.follow(stderr);
            drop(sender);
        })?;
        Ok(Self { process, stdin, stdout, log, log_end })
    }

    /// Writes all of `bytes`.
    ///
    /// # Errors
    /// The program does not take them before the deadline.
    pub fn write(&mut self, bytes: &[u8], deadline: Instant) -> Result<(), Silence> {
        for piece in bytes.chunks(PIECE) {
            wait(&self.stdin, PollFlags::OUT, deadline)?;
            self.stdin.write_all(piece).map_err(Silence::of)?;
        }
        Ok(())
    }

    /// Fills `bytes` from standard output.
    ///
    /// # Errors
    /// They do not come before the deadline.
    pub fn read(&mut self, bytes: &mut [u8], deadline: Instant) -> Result<(), Silence> {
        let mut at = 0;
        while at < bytes.len() {
            wait(&self.stdout, PollFlags::IN, deadline)?;
            match self.stdout.read(&mut bytes[at..]) {
                Ok(0) => return Err(Silence::Closed),
                Ok(count) => at += count,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(Silence::of(error)),
            }
        }
        Ok(())
    }

    /// Ends the program and all that it started, and returns how it ended.
    pub fn end(&mut self) -> Option<ExitStatus> {
        // A program that has just closed its pipes may still be about to end by itself.
        for _ in 0..10 {
            if let Ok(Some(status)) = self.process.try_wait() {
                self.kill_group();
                return Some(status);
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        self.kill_group();
        self.process.wait().ok()
    }

    /// The last lines of standard error. Call it after [`Child::end`].
    pub fn last_words(&self) -> Vec<String> {
        _ = self.log_end.recv_timeout(LAST_WORDS);
        self.log.last_lines()
    }

    fn kill_group(&self) {
        if let Some(group) = i32::try_from(self.process.id()).ok().and_then(Pid::from_raw) {
            _ = kill_process_group(group, Signal::KILL);
        }
    }
}

impl Drop for Child {
    fn drop(&mut self) {
        self.kill_group();
        _ = self.process.wait();
    }
}

impl Silence {
    fn of(error: io::Error) -> Self {
        if error.kind() == io::ErrorKind::BrokenPipe { Self::Closed } else { Self::System(error) }
    }
}

/// Lets the kernel kill the program when this process dies, however it dies.
#[allow(
    unsafe_code,
    reason = "between fork and exec, only a closure that is marked so can ask the kernel for the signal"
)]
fn die_with_this_process(command: &mut Command) {
    let parent = getpid();
    let ask = move || {
        set_parent_process_death_signal(Some(Signal::KILL))?;
        // The parent may have died before the kernel was asked.
        if getppid() == Some(parent) { Ok(()) } else { Err(io::ErrorKind::NotFound.into()) }
    };
    // SAFETY: the closure makes two system calls. It allocates nothing and takes no lock.
    unsafe {
        command.pre_exec(ask);
    }
}

/// Waits until a pipe is ready.
fn wait(pipe: impl AsFd, flags: PollFlags, deadline: Instant) -> Result<(), Silence> {
    loop {
        let left = deadline.saturating_duration_since(Instant::now());
        let timeout = Timespec { tv_sec: left.as_secs() as i64, tv_nsec: i64::from(left.subsec_nanos()) };
        match poll(&mut [PollFd::new(&pipe, flags)], Some(&timeout)) {
            Ok(0) => return Err(Silence::Late),
            Ok(_) => return Ok(()),
            Err(rustix::io::Errno::INTR) => {}
            Err(error) => return Err(Silence::System(error.into())),
        }
    }
}

/// Lines that a program wrote to its standard error. Clones share the lines.
#[derive(Debug, Clone, Default)]
pub struct Log(Arc<Mutex<Lines>>);

#[derive(Debug, Default)]
struct Lines {
    /// Lines that nobody has taken yet.
    new: VecDeque<String>,
    last: VecDeque<String>,
    /// New lines that were dropped since there were too many.
    dropped: usize,
}

impl Log {
    /// The lines since the last call. Of very many lines it has the newest.
    pub fn take(&self) -> Vec<String> {
        let mut lines = self.lines();
        let dropped = std::mem::take(&mut lines.dropped);
        let note = (dropped > 0).then(|| format!("({dropped} lines are left out)"));
        note.into_iter().chain(lines.new.drain(..)).collect()
    }

    fn last_lines(&self) -> Vec<String> {
        self.lines().last.iter().cloned().collect()
    }

    fn lines(&self) -> MutexGuard<'_, Lines> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Keeps lines until the pipe is closed.
    fn follow(&self, stderr: ChildStderr) {
        let mut stderr = io::BufReader::new(stderr);
        let mut line = Vec::new();
        while matches!(stderr.by_ref().take(LONGEST_LINE).read_until(b'\n', &mut line), Ok(count) if count > 0) {
            self.keep(String::from_utf8_lossy(&line).trim_end().to_owned());
            line.clear();
        }
    }

    fn keep(&self, line: String) {
        let mut lines = self.lines();
        if lines.last.len() == SHOWN_LINES {
            lines.last.pop_front();
        }
        lines.last.push_back(line.clone());
        if lines.new.len() == MOST_LINES {
            lines.new.pop_front();
            lines.dropped += 1;
        }
        lines.new.push_back(line);
    }
}
