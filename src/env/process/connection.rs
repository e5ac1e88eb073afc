//! A running environment: requests, and their answers within a time.

#![allow(clippy::disallowed_methods, reason = "a deadline says when an answer is too late; no result holds a time")]

use std::time::{Duration, Instant};

use anyhow::Context as _;

use super::{
    program::Program,
    wire::{self, About, LONGEST_FRAME, Reset, Seen, Step, Welcome},
};
use crate::child::{Child, Log, Silence};

/// An environment's process. It ends when the value is dropped.
#[derive(Debug)]
pub struct Connection {
    child: Child,
    program: String,
    timeout: Duration,
    about: About,
    goals: Vec<Vec<u8>>,
}

impl Connection {
    /// Starts the program of an environment and greets it. Its standard error goes to `log`.
    ///
    /// # Errors
    /// The program does not start, or it does not answer as the protocol wants.
    pub fn open(program: &Program, log: Log) -> anyhow::Result<Self> {
        let shown = program.command.join(" ");
        let folder = program.folder()?;
        let child = Child::start(&program.command, folder, log);
        let child = child.with_context(|| format!("cannot start the environment `{shown}`"))?;
        let timeout = Duration::from_secs_f64(program.timeout);
        let mut unknown = Unknown { child, program: shown, timeout };
        let Welcome { about, goals } = unknown.ask(&wire::hello(&program.options), wire::welcome)?;
        let Unknown { child, program, timeout } = unknown;
        Ok(Self { child, program, timeout, about, goals })
    }

    /// What the environment says of itself.
    pub fn about(&self) -> &About {
        &self.about
    }

    /// The picture of a goal.
    pub fn goal(&self, goal: usize) -> &[u8] {
        &self.goals[goal]
    }

    /// Begins episodes in some of the environments of the process.
    ///
    /// # Errors
    /// The process has ended, is late, or answers wrongly.
    pub fn reset(&mut self, resets: &[Reset]) -> anyhow::Result<Vec<Seen>> {
        let about = &self.about;
        let read = |frame: &[u8]| wire::seen(frame, about, resets.iter().map(|reset| reset.env));
        ask(&mut self.child, &self.program, self.timeout, &wire::reset(resets), read)
    }

    /// Makes a control step in some of the environments of the process.
    ///
    /// # Errors
    /// The process has ended, is late, or answers wrongly.
    pub fn step(&mut self, steps: &[Step]) -> anyhow::Result<Vec<Seen>> {
        let about = &self.about;
        let read = |frame: &[u8]| wire::seen(frame, about, steps.iter().map(|step| step.env));
        ask(&mut self.child, &self.program, self.timeout, &wire::step(steps), read)
    }
}

/// A process that has not described itself yet.
struct Unknown {
    child: Child,
    program: String,
    timeout: Duration,
}

impl Unknown {
    fn ask<T>(&mut self, request: &[u8], read: impl Fn(&[u8]) -> anyhow::Result<T>) -> anyhow::Result<T> {
        ask(&mut self.child, &self.program, self.timeout, request, read)
    }
}

/// Sends a request and reads the answer. An environment that fails once is ended.
fn ask<T>(
    child: &mut Child,
    program: &str,
    timeout: Duration,
    request: &[u8],
    read: impl Fn(&[u8]) -> anyhow::Result<T>,
) -> anyhow::Result<T> {
    let deadline = Instant::now() + timeout;
    let answer = child.write(request, deadline).and_then(|()| frame(child, deadline));
    let why = match answer {
        Ok(Some(frame)) => match read(&frame) {
            Ok(answer) => return Ok(answer),
            Err(error) => {
                child.end();
                error
            }
        },
        Ok(None) => {
            child.end();
            wire::garbage()
        }
        Err(Silence::Late) => {
            child.end();
            let secs = timeout.as_secs_f64();
            anyhow::anyhow!(
                "the environment did not answer within {secs} s: raise `timeout` in `[task]` if it needs more"
            )
        }
        Err(Silence::Closed) => match child.end() {
            Some(status) => anyhow::anyhow!("the environment ended ({status})"),
            None => anyhow::anyhow!("the environment ended"),
        },
        Err(Silence::System(error)) => {
            child.end();
            anyhow::Error::new(error).context("cannot talk to the environment")
        }
    };
    Err(Failed { program: program.to_owned(), why: format!("{why:#}"), last_words: child.last_words() }.into())
}

/// An environment that failed, with the last lines of its standard error.
#[derive(Debug)]
pub(super) struct Failed {
    program: String,
    why: String,
    last_words: Vec<String>,
}

impl Failed {
    /// The failure in one line, with the last one of its standard error.
    pub(super) fn in_one_line(&self) -> String {
        let word = self.last_words.last().map(|word| format!("; its last line: {word}"));
        format!("`{}`: {}{}", self.program, self.why, word.unwrap_or_default())
    }
}

impl std::fmt::Display for Failed {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "`{}`: {}", self.program, self.why)?;
        if !self.last_words.is_empty() {
            write!(f, "; its last lines:\n{}", self.last_words.join("\n"))?;
        }
        Ok(())
    }
}

impl std::error::Error for Failed {}

/// The next frame without its length; `None` where the bytes cannot be one.
fn frame(child: &mut Child, deadline: Instant) -> Result<Option<Vec<u8>>, Silence> {
    let mut length = [0; 4];
    child.read(&mut length, deadline)?;
    let length = u32::from_le_bytes(length) as usize;
    if !(1..=LONGEST_FRAME).contains(&length) {
        return Ok(None);
    }
    let mut frame = vec![0; length];
    child.read(&mut frame, deadline)?;
    Ok(Some(frame))
}
