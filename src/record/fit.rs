//! Tells a recording that can be shown from another file.

use std::{fs::File, io::Read as _, path::Path};

use super::{
    frame::Message,
    reader::{Polled, Reader},
};

/// How every MCAP file begins.
const MAGIC: [u8; 8] = *b"\x89MCAP0\r\n";

/// Why a file shows nothing.
#[derive(Debug, thiserror::Error)]
pub enum Unfit {
    /// It is something else.
    #[error("it is not an MCAP file")]
    NotMcap,
    /// Another program made it.
    #[error("it is an MCAP file without carl-pipe's schemas")]
    Foreign,
    /// Nothing was recorded, or it was cut before the first message.
    #[error("it holds no message")]
    Empty,
    /// No message can be read.
    #[error("it is a damaged recording: {0}")]
    Damaged(String),
    /// The system refused to read it.
    #[error("it cannot be read: {0}")]
    Unreadable(String),
}

/// Reads a file up to the first message that a view can show.
///
/// # Errors
/// Why there is none.
pub fn check(path: &Path) -> Result<(), Unfit> {
    let mut start = Vec::new();
    let read = File::open(path).and_then(|file| file.take(MAGIC.len() as u64).read_to_end(&mut start));
    read.map_err(|error| Unfit::Unreadable(error.to_string()))?;
    if start != MAGIC {
        return Err(Unfit::NotMcap);
    }
    let damaged = |error: anyhow::Error| Unfit::Damaged(format!("{error:#}"));
    let mut reader = Reader::open(path).map_err(|error| Unfit::Unreadable(format!("{error:#}")))?;
    let mut has_messages = false;
    loop {
        match reader.poll().map_err(damaged)? {
            Polled::Message(message) if Message::decode(&message).map_err(damaged)?.is_some() => return Ok(()),
            Polled::Message(_) => has_messages = true,
            Polled::Metadata(_) => {}
            Polled::Waiting | Polled::End => break,
        }
    }
    Err(if has_messages { Unfit::Foreign } else { Unfit::Empty })
}
