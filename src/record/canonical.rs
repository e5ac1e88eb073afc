//! Turns a live recording into the one file that its messages determine, and digests it.

use std::{
    collections::BTreeMap,
    fs::File,
    io::{BufWriter, Write},
    path::Path,
};

use anyhow::{Context as _, bail};
use mcap::records::MessageHeader;

use super::{
    live::mcap_writer,
    reader::{Polled, Reader},
};

/// What identifies a recording.
#[derive(Debug, Clone, Copy)]
pub(super) struct Digests {
    pub messages: [u8; 32],
    pub file: [u8; 32],
}

/// Writes what `live` holds to `canonical`: chunks end by size alone, never where a clock flushed.
pub(super) fn rewrite(live: &Path, canonical: &Path) -> anyhow::Result<Digests> {
    let mut reader = Reader::open(live)?;
    let mut messages = blake3::Hasher::new();
    let mut output = Hashed { file: BufWriter::new(File::create(canonical)?), hasher: blake3::Hasher::new() };
    let mut writer = mcap_writer(&mut output)?;
    let mut channel_ids = BTreeMap::new();
    loop {
        match reader.poll()? {
            Polled::Message(message) => {
                let channel = message.channel;
                let channel_id = match channel_ids.get(&channel.id) {
                    Some(&id) => id,
                    None => {
                        let schema = writer.add_schema(&channel.schema, "protobuf", &channel.schema_data)?;
                        let id = writer.add_channel(schema, &channel.topic, "protobuf", &BTreeMap::new())?;
                        channel_ids.insert(channel.id, id);
                        id
                    }
                };
                for part in [channel.topic.as_bytes(), channel.schema.as_bytes(), &channel.schema_data, message.data] {
                    messages.update(&(part.len() as u64).to_le_bytes());
                    messages.update(part);
                }
                messages.update(&message.log_time.to_le_bytes());
                let header = MessageHeader {
                    channel_id,
                    sequence: message.sequence,
                    log_time: message.log_time,
                    publish_time: message.log_time,
                };
                writer.write_to_known_channel(&header, message.data)?;
            }
            Polled::Metadata(metadata) => writer.write_metadata(metadata)?,
            Polled::End => break,
            Polled::Waiting => bail!("{} does not end", live.display()),
        }
    }
    writer.finish()?;
    drop(writer);
    output.flush().with_context(|| format!("cannot write {}", canonical.display()))?;
    Ok(Digests { messages: messages.finalize().into(), file: output.hasher.finalize().into() })
}

/// Hashes what it writes.
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
