//! Rewrites a live recording into its canonical file, whose bytes depend on the messages alone, and hashes both.

use std::{
    collections::BTreeMap,
    fs::File,
    io::{BufWriter, Write},
    path::Path,
};

use anyhow::{Context as _, bail};
use mcap::{Writer, records::MessageHeader, write::NoSeek};

use super::{
    reader::{Channel, Polled, RawMessage, Reader},
    writer::mcap_writer,
};
use crate::failpoint::failpoint;

/// The digests of a recording.
#[derive(Debug, Clone, Copy)]
pub(super) struct Digests {
    /// blake3 of the messages.
    pub(super) messages: [u8; 32],
    /// blake3 of the file.
    pub(super) file: [u8; 32],
}

/// Writes the messages of `live` to `canonical`. Chunks end by size alone, not where the live file was flushed.
pub(super) fn rewrite(live: &Path, canonical: &Path) -> anyhow::Result<Digests> {
    let mut reader = Reader::open(live)?;
    let mut messages = blake3::Hasher::new();
    let file = failpoint!("start finished recording", File::create(canonical))?;
    let mut output = Hashed { file: BufWriter::new(file), hasher: blake3::Hasher::new() };
    let mut writer = mcap_writer(&mut output)?;
    let mut channel_ids = BTreeMap::new();
    loop {
        match reader.poll()? {
            Polled::Message(message) => {
                let channel_id = match channel_ids.get(&message.channel.id) {
                    Some(&id) => id,
                    None => {
                        let id = add_channel(&mut writer, message.channel)?;
                        channel_ids.insert(message.channel.id, id);
                        id
                    }
                };
                hash_message(&mut messages, &message);
                let (sequence, log_time) = (message.sequence, message.log_time);
                let header = MessageHeader { channel_id, sequence, log_time, publish_time: log_time };
                writer.write_to_known_channel(&header, message.data)?;
            }
            Polled::Metadata(metadata) => writer.write_metadata(metadata)?,
            Polled::End => break,
            Polled::Waiting => bail!("{} has no end", live.display()),
        }
    }
    writer.finish()?;
    drop(writer);
    failpoint!("finish recording", output.flush()).with_context(|| format!("cannot write {}", canonical.display()))?;
    Ok(Digests { messages: messages.finalize().into(), file: output.hasher.finalize().into() })
}

fn add_channel<W: Write>(writer: &mut Writer<NoSeek<W>>, channel: &Channel) -> mcap::McapResult<u16> {
    let schema = writer.add_schema(&channel.schema, "protobuf", &channel.schema_data)?;
    writer.add_channel(schema, &channel.topic, "protobuf", &BTreeMap::new())
}

fn hash_message(hasher: &mut blake3::Hasher, message: &RawMessage<'_>) {
    let channel = message.channel;
    for part in [channel.topic.as_bytes(), channel.schema.as_bytes(), &channel.schema_data, message.data] {
        hasher.update(&(part.len() as u64).to_le_bytes());
        hasher.update(part);
    }
    hasher.update(&message.log_time.to_le_bytes());
}

/// A file that hashes the bytes written to it.
struct Hashed<W> {
    file: W,
    hasher: blake3::Hasher,
}

impl<W: Write> Write for Hashed<W> {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let written = self.file.write(bytes)?;
        self.hasher.update(&bytes[..written]);
        Ok(written)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.file.flush()
    }
}
