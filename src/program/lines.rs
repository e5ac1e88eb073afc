//! The lines that a program writes, from all its pipes in one queue.

use std::{
    io::{BufRead as _, BufReader, Read},
    process::{ChildStderr, ChildStdout},
    sync::mpsc::{Receiver, SyncSender, sync_channel},
    thread,
};

/// The longest line. What follows is left out.
const LONGEST: u64 = 64 << 10;
/// How many lines wait until the program has to wait too.
const WAITING: usize = 1024;

/// Where a program wrote a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Source {
    /// Standard output.
    Output,
    /// Standard error.
    Error,
    /// The descriptor of events.
    Events,
}

/// A line without its end. Bytes that are not UTF-8 are replaced.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Line {
    /// Where it was written.
    pub source: Source,
    /// What was written.
    pub text: String,
}

/// Reads three pipes in a thread each. The queue ends once all pipes have ended.
pub(super) fn read_all(output: ChildStdout, error: ChildStderr, events: impl Read + Send + 'static) -> Receiver<Line> {
    let (send, lines) = sync_channel(WAITING);
    read(output, Source::Output, send.clone());
    read(error, Source::Error, send.clone());
    read(events, Source::Events, send);
    lines
}

fn read(pipe: impl Read + Send + 'static, source: Source, send: SyncSender<Line>) {
    thread::spawn(move || {
        let mut pipe = BufReader::new(pipe);
        let mut bytes = Vec::new();
        loop {
            bytes.clear();
            let read = (&mut pipe).take(LONGEST).read_until(b'\n', &mut bytes);
            if !matches!(read, Ok(1..)) {
                return;
            }
            let is_whole = bytes.pop_if(|byte| *byte == b'\n').is_some();
            let text = String::from_utf8_lossy(&bytes).trim_end_matches('\r').to_owned();
            if send.send(Line { source, text }).is_err() || !is_whole && pipe.skip_until(b'\n').is_err() {
                return;
            }
        }
    });
}
