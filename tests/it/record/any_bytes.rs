//! Any file read as a recording ends in messages or in an error: no panic, no endless loop, no absurd memory.

use std::fs;

use crate::support::mutated::{any_bytes, corpus, mutation, within};
use carl_pipe::record::{Message, Polled, Reader};
use proptest::prelude::*;

/// The largest record that the reader takes. A few bytes can decompress to as many.
const LARGEST: usize = 256 << 20;

/// Reads all messages; the error ends the reading.
fn read(bytes: &[u8]) -> anyhow::Result<Vec<Message>> {
    within(LARGEST + (1 << 20), || messages(bytes))
}

fn messages(bytes: &[u8]) -> anyhow::Result<Vec<Message>> {
    let file = tempfile::NamedTempFile::new()?;
    fs::write(file.path(), bytes)?;
    let mut reader = Reader::open(file.path())?;
    let mut messages = Vec::new();
    loop {
        match reader.poll()? {
            Polled::Message(raw) => messages.extend(Message::decode(&raw)?),
            Polled::Metadata(_) => {}
            Polled::Waiting => anyhow::bail!("it was cut short"),
            Polled::End => return Ok(messages),
        }
        assert!(messages.len() <= bytes.len(), "more messages than bytes");
    }
}

#[test]
fn the_corpus_is_read_or_refused() {
    for (path, bytes, is_whole) in corpus("recordings") {
        let read = read(&bytes);
        assert_eq!(read.is_ok(), is_whole, "{}: {:?}", path.display(), read.err());
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn arbitrary_bytes(bytes in any_bytes()) {
        prop_assert!(read(&bytes).is_err());
    }

    #[test]
    fn a_recording_with_any_change(mutation in mutation()) {
        let (_, bytes) = mutation.of_corpus("recordings");
        drop(read(&bytes));
    }
}
