//! Reads a recording message by message. The recording may be finished, still growing, or cut short.

use std::{collections::BTreeMap, fs::File, io::Read as _, path::Path, sync::Arc};

use anyhow::{Context as _, ensure};
use mcap::{
    parse_record,
    records::{Metadata, Record, op},
    sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions},
};

use super::{node_info::NodeInfo, schema};

/// A chunk or message that claims to be larger is damaged. It is not read into memory.
const LARGEST_RECORD: usize = 256 << 20;
const READ_SIZE: usize = 64 << 10;
/// The most memory that is reserved at once, since a damaged length may claim more than the file holds.
const LARGEST_READ: usize = 1 << 20;

/// The kinds of records that are read: messages, their channels and schemas, and metadata.
const READ: [u8; 4] = [op::SCHEMA, op::CHANNEL, op::MESSAGE, op::METADATA];

/// A topic of a recording and the encoding of its messages.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Channel {
    /// Number of the channel within the file.
    pub id: u16,
    /// The topic, such as `/train/lce`.
    pub topic: String,
    /// Full name of the message type.
    pub schema: String,
    /// Encoded descriptor set of the message type.
    pub schema_data: Vec<u8>,
    /// The names of the values; empty if the messages are not scalars.
    pub value_names: Arc<[String]>,
}

/// An encoded message.
#[derive(Debug, Clone, Copy)]
pub struct RawMessage<'a> {
    /// The channel of the message.
    pub channel: &'a Channel,
    /// Number of the message within its channel.
    pub sequence: u32,
    /// Logical time in nanoseconds.
    pub log_time: u64,
    /// The encoded message.
    pub data: &'a [u8],
}

/// The next item of a recording.
#[derive(Debug)]
pub enum Polled<'a> {
    /// A message.
    Message(RawMessage<'a>),
    /// A metadata record.
    Metadata(&'a Metadata),
    /// The file stops here, but it is not finished. It may grow, or it was cut short.
    Waiting,
    /// The file is finished.
    End,
}

/// A record that [`Reader::poll`] returns. Its content lies in the reader.
enum Found {
    Message { channel: u16, sequence: u32, log_time: u64 },
    Metadata,
}

/// Reads one recording.
pub struct Reader {
    file: File,
    mcap: LinearReader,
    contents: Contents,
}

impl std::fmt::Debug for Reader {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Reader").field("file", &self.file).field("node", &self.contents.node).finish_non_exhaustive()
    }
}

impl Reader {
    /// Opens a recording. Reads nothing yet.
    ///
    /// # Errors
    /// If the file cannot be opened.
    pub fn open(path: &Path) -> anyhow::Result<Reader> {
        let file = File::open(path).with_context(|| format!("cannot open {}", path.display()))?;
        let options =
            LinearReaderOptions::default().with_validate_chunk_crcs(true).with_record_length_limit(LARGEST_RECORD);
        Ok(Reader { file, mcap: LinearReader::new_with_options(options), contents: Contents::new() })
    }

    /// The node that made the recording. Known once the first record was read.
    pub fn node(&self) -> Option<&NodeInfo> {
        self.contents.node.as_ref()
    }

    /// Reads the next item. After [`Polled::Waiting`], a later call may find that the file has grown.
    ///
    /// # Errors
    /// If the file cannot be read or is damaged. Earlier items are valid.
    pub fn poll(&mut self) -> anyhow::Result<Polled<'_>> {
        loop {
            let Some(event) = self.mcap.next_event() else { return Ok(Polled::End) };
            let found = match event? {
                LinearReadEvent::ReadRequest(wanted) => {
                    let space = self.mcap.insert(wanted.clamp(READ_SIZE, LARGEST_READ));
                    let read = self.file.read(space)?;
                    if read == 0 {
                        return Ok(Polled::Waiting);
                    }
                    self.mcap.notify_read(read);
                    None
                }
                LinearReadEvent::Record { opcode, data } if READ.contains(&opcode) => {
                    ensure!(has_its_lengths(opcode, data), "a record states a length beyond its end");
                    self.contents.take(parse_record(opcode, data)?)
                }
                LinearReadEvent::Record { .. } => None,
            };
            if let Some(found) = found {
                return Ok(self.contents.item(found));
            }
        }
    }
}

/// Whether the texts and tables of a record fit into the record. The library reserves memory for the lengths that a
/// record states before it reads the bytes.
fn has_its_lengths(opcode: u8, data: &[u8]) -> bool {
    fn block<'a>(rest: &mut &'a [u8]) -> Option<&'a [u8]> {
        let length;
        (length, *rest) = rest.split_at_checked(4)?;
        let length = u32::from_le_bytes(length.try_into().ok()?);
        let block;
        (block, *rest) = rest.split_at_checked(length as usize)?;
        Some(block)
    }
    // Where the blocks begin, how many there are, and whether the last is a table, which holds blocks.
    let (begin, blocks, has_table) = match opcode {
        op::SCHEMA => (2, 3, false),
        op::CHANNEL => (4, 3, true),
        op::METADATA => (0, 2, true),
        _ => return true,
    };
    let check = || {
        let mut rest = data.get(begin..)?;
        let mut last = &data[..0];
        for _ in 0..blocks {
            last = block(&mut rest)?;
        }
        while has_table && !last.is_empty() {
            block(&mut last)?;
        }
        Some(())
    };
    check().is_some()
}

/// What was read so far: the channels, and the latest message and metadata record.
struct Contents {
    schemas: BTreeMap<u16, (String, Vec<u8>)>,
    channels: BTreeMap<u16, Channel>,
    payload: Vec<u8>,
    metadata: Metadata,
    node: Option<NodeInfo>,
}

impl Contents {
    fn new() -> Contents {
        Contents {
            schemas: BTreeMap::new(),
            channels: BTreeMap::new(),
            payload: Vec::new(),
            metadata: Metadata { name: String::new(), metadata: BTreeMap::new() },
            node: None,
        }
    }

    /// Keeps the content of a record. Returns where it lies if it is an item for the caller.
    fn take(&mut self, record: Record<'_>) -> Option<Found> {
        match record {
            Record::Schema { header, data } => {
                self.schemas.insert(header.id, (header.name, data.into_owned()));
            }
            Record::Channel(channel) => {
                let (schema, schema_data) = self.schemas.get(&channel.schema_id).cloned().unwrap_or_default();
                let is_scalars = schema.starts_with(schema::SCALARS);
                let names = if is_scalars { schema::value_names(&schema_data) } else { None };
                let value_names = names.unwrap_or_default().into();
                let channel = Channel { id: channel.id, topic: channel.topic, schema, schema_data, value_names };
                self.channels.insert(channel.id, channel);
            }
            Record::Message { header, data } if self.channels.contains_key(&header.channel_id) => {
                self.payload.clear();
                self.payload.extend_from_slice(&data);
                let (channel, sequence, log_time) = (header.channel_id, header.sequence, header.log_time);
                return Some(Found::Message { channel, sequence, log_time });
            }
            Record::Metadata(metadata) => {
                self.node = NodeInfo::from_metadata(&metadata).or(self.node.take());
                self.metadata = metadata;
                return Some(Found::Metadata);
            }
            _ => {}
        }
        None
    }

    fn item(&self, found: Found) -> Polled<'_> {
        match found {
            Found::Message { channel, sequence, log_time } => {
                let channel = &self.channels[&channel];
                Polled::Message(RawMessage { channel, sequence, log_time, data: &self.payload })
            }
            Found::Metadata => Polled::Metadata(&self.metadata),
        }
    }
}
