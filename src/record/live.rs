//! The MCAP file of a node that works. It is flushed several times a second, so that a view can follow it.

#![allow(clippy::disallowed_methods, reason = "wall time decides when to flush; recordings hold logical time only")]

use std::{
    collections::BTreeMap,
    fs::File,
    io::BufWriter,
    path::Path,
    time::{Duration, Instant},
};

use mcap::{Writer, records::MessageHeader, write::NoSeek};

use super::{node_info::NodeInfo, schema::Schema, time::At, writer::mcap_writer};
use crate::failpoint::failpoint;

/// The longest delay of a follower, and the most that is lost when the process is killed.
const FLUSH_INTERVAL: Duration = Duration::from_millis(400);

/// The message type of a channel.
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
    /// How many messages were written.
    messages: u32,
}

/// Index of a channel in a live file.
#[derive(Debug, Clone, Copy)]
pub(super) struct ChannelIndex(usize);

/// A recording that is being written.
pub(super) struct LiveFile {
    writer: Writer<NoSeek<BufWriter<File>>>,
    channels: Vec<Channel>,
    /// The encoded message. The buffer is kept, so that recording scalars allocates nothing.
    pub(super) payload: Vec<u8>,
    last_flush: Instant,
}

impl LiveFile {
    /// Creates the file and its folder, and writes the metadata record.
    pub(super) fn create(path: &Path, node: &NodeInfo) -> mcap::McapResult<LiveFile> {
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder)?;
        }
        let mut writer = mcap_writer(BufWriter::new(failpoint!("open recording", File::create(path))?))?;
        writer.write_metadata(&node.to_metadata())?;
        writer.flush()?;
        Ok(LiveFile { writer, channels: Vec::new(), payload: Vec::new(), last_flush: Instant::now() })
    }

    /// The channel of a topic whose shape `is_same` accepts. It is made on first use.
    pub(super) fn channel(
        &mut self,
        topic: &str,
        is_same: impl Fn(&Shape) -> bool,
        make: impl FnOnce() -> (Shape, Schema),
    ) -> mcap::McapResult<ChannelIndex> {
        if let Some(index) = self.channels.iter().position(|c| c.topic == topic && is_same(&c.shape)) {
            return Ok(ChannelIndex(index));
        }
        let (shape, schema) = make();
        let schema_id = self.writer.add_schema(&schema.name, "protobuf", &schema.data)?;
        let id = self.writer.add_channel(schema_id, topic, "protobuf", &BTreeMap::new())?;
        self.channels.push(Channel { topic: topic.to_owned(), shape, id, messages: 0 });
        Ok(ChannelIndex(self.channels.len() - 1))
    }

    /// Writes `payload` as the next message of a channel.
    pub(super) fn write(&mut self, ChannelIndex(index): ChannelIndex, at: At) -> mcap::McapResult<()> {
        let channel = &mut self.channels[index];
        let time = at.log_time();
        let header =
            MessageHeader { channel_id: channel.id, sequence: channel.messages, log_time: time, publish_time: time };
        channel.messages = channel.messages.wrapping_add(1);
        self.writer.write_to_known_channel(&header, &self.payload)
    }

    /// Flushes if the last flush is long enough ago.
    pub(super) fn flush_if_due(&mut self, now: Instant) -> mcap::McapResult<()> {
        if now.duration_since(self.last_flush) < FLUSH_INTERVAL {
            return Ok(());
        }
        self.last_flush = now;
        self.flush()
    }

    /// Ends the present chunk and writes everything to the file.
    pub(super) fn flush(&mut self) -> mcap::McapResult<()> {
        failpoint!("write recording", self.writer.flush())
    }
}
