//! The MCAP file of a node while it works: whole chunks only, flushed often, so that a reader can follow it.

#![allow(
    clippy::disallowed_methods,
    reason = "wall time paces flushes and measures the cost of recording; recordings hold logical time only"
)]

use std::{
    collections::BTreeMap,
    fs::File,
    io::{BufWriter, Write},
    path::Path,
    time::{Duration, Instant},
};

use mcap::{
    WriteOptions, Writer,
    records::{MessageHeader, Metadata},
    write::NoSeek,
};

use super::{recorder::NodeInfo, schema::Schema, time::At};

/// A follower sees data this late at most, and a kill loses this much.
const FLUSH_EVERY: Duration = Duration::from_millis(400);

/// Writes MCAP with everything fixed that could make equal messages give other bytes.
///
/// Without seeking, a chunk reaches the file whole: a follower never meets a length that is filled in later.
pub(super) fn mcap_writer<W: Write>(file: W) -> mcap::McapResult<Writer<NoSeek<W>>> {
    let options = WriteOptions::new()
        .library("carl-pipe")
        .profile("")
        .compression(Some(mcap::Compression::Zstd))
        .compression_threads(1)
        .chunk_size(Some(1 << 20))
        .disable_seeking(true);
    options.create(NoSeek::new(file))
}

/// The metadata record of a recording.
pub(super) const NODE_METADATA: &str = "carl.node";

/// What the messages of a channel look like.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Shape {
    Scalars(Vec<&'static str>),
    Cloud,
    Image,
    Log,
    Trajectory,
}

struct Channel {
    topic: String,
    shape: Shape,
    id: u16,
    messages: u32,
}

/// A recording that is being written.
pub(super) struct LiveFile {
    writer: Writer<NoSeek<BufWriter<File>>>,
    channels: Vec<Channel>,
    /// The encoded message; kept so that recording allocates nothing.
    pub payload: Vec<u8>,
    last_flush: Instant,
}

impl LiveFile {
    pub(super) fn create(path: &Path, node: &NodeInfo) -> mcap::McapResult<LiveFile> {
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder)?;
        }
        let mut writer = mcap_writer(BufWriter::new(File::create(path)?))?;
        writer.write_metadata(&node.to_metadata())?;
        writer.flush()?;
        Ok(LiveFile { writer, channels: Vec::new(), payload: Vec::new(), last_flush: Instant::now() })
    }

    /// The channel of this topic and shape, made on first use.
    pub(super) fn channel(
        &mut self,
        topic: &str,
        same: impl Fn(&Shape) -> bool,
        make: impl FnOnce() -> (Shape, Schema),
    ) -> mcap::McapResult<usize> {
        if let Some(index) = self.channels.iter().position(|c| c.topic == topic && same(&c.shape)) {
            return Ok(index);
        }
        let (shape, schema) = make();
        let schema_id = self.writer.add_schema(&schema.name, "protobuf", &schema.data)?;
        let id = self.writer.add_channel(schema_id, topic, "protobuf", &BTreeMap::new())?;
        self.channels.push(Channel { topic: topic.to_owned(), shape, id, messages: 0 });
        Ok(self.channels.len() - 1)
    }

    /// Writes `payload` as the channel's next message.
    pub(super) fn write(&mut self, channel: usize, at: At) -> mcap::McapResult<()> {
        let channel = &mut self.channels[channel];
        let time = at.log_time();
        let header =
            MessageHeader { channel_id: channel.id, sequence: channel.messages, log_time: time, publish_time: time };
        channel.messages = channel.messages.wrapping_add(1);
        self.writer.write_to_known_channel(&header, &self.payload)
    }

    pub(super) fn flush_if_due(&mut self, now: Instant) -> mcap::McapResult<()> {
        if now.duration_since(self.last_flush) < FLUSH_EVERY {
            return Ok(());
        }
        self.last_flush = now;
        self.writer.flush()
    }

    pub(super) fn flush(&mut self) -> mcap::McapResult<()> {
        self.writer.flush()
    }
}

impl NodeInfo {
    fn to_metadata(&self) -> Metadata {
        let NodeInfo { node, kind, key, round } = self;
        let pairs =
            [("node", node.clone()), ("kind", kind.clone()), ("key", key.clone()), ("round", round.to_string())];
        Metadata {
            name: NODE_METADATA.to_owned(),
            metadata: pairs.map(|(name, value)| (name.to_owned(), value)).into(),
        }
    }

    pub(super) fn from_metadata(metadata: &Metadata) -> Option<NodeInfo> {
        let value = |name: &str| metadata.metadata.get(name).cloned().unwrap_or_default();
        (metadata.name == NODE_METADATA).then(|| NodeInfo {
            node: value("node"),
            kind: value("kind"),
            key: value("key"),
            round: value("round").parse().unwrap_or(0),
        })
    }
}
