//! Reads a recording message by message, whether it is finished, still growing or cut short.

use std::{collections::BTreeMap, fs::File, io::Read as _, path::Path};

use anyhow::Context as _;
use mcap::{
    parse_record,
    records::{Metadata, Record},
    sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions},
};

use super::{recorder::NodeInfo, schema};

/// A chunk or message above this is taken for damage, not read into memory.
const LARGEST_RECORD: usize = 256 << 20;
const READ_SIZE: usize = 64 << 10;
/// A damaged length must not reserve what the file cannot hold.
const LARGEST_READ: usize = 1 << 20;

/// A topic of a recording and how its messages are encoded.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Channel {
    /// Its number within the file.
    pub id: u16,
    /// What the messages are about, such as `/train/lce`.
    pub topic: String,
    /// Full name of the message type.
    pub schema: String,
    /// The type's descriptor set.
    pub schema_data: Vec<u8>,
    /// The names of its values, where it holds scalars.
    pub value_names: std::sync::Arc<[String]>,
}

/// A message as it lies in the file.
#[derive(Debug, Clone, Copy)]
pub struct RawMessage<'a> {
    /// Where it was sent.
    pub channel: &'a Channel,
    /// Its number within the channel.
    pub sequence: u32,
    /// Logical time in nanoseconds.
    pub log_time: u64,
    /// The encoded message.
    pub data: &'a [u8],
}

/// What the file holds next.
#[derive(Debug)]
pub enum Polled<'a> {
    /// A message.
    Message(RawMessage<'a>),
    /// A metadata record.
    Metadata(&'a Metadata),
    /// The file stops here without being finished: it may grow, or was cut short.
    Waiting,
    /// The file is finished.
    End,
}

enum Found {
    Message { channel: u16, sequence: u32, log_time: u64 },
    Metadata,
}

/// Reads one recording.
pub struct Reader {
    file: File,
    mcap: LinearReader,
    schemas: BTreeMap<u16, (String, Vec<u8>)>,
    channels: BTreeMap<u16, Channel>,
    payload: Vec<u8>,
    metadata: Metadata,
    node: Option<NodeInfo>,
}

impl std::fmt::Debug for Reader {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Reader").field("file", &self.file).field("node", &self.node).finish_non_exhaustive()
    }
}

impl Reader {
    /// Opens a recording; nothing is read yet.
    ///
    /// # Errors
    /// If the file cannot be opened.
    pub fn open(path: &Path) -> anyhow::Result<Reader> {
        let file = File::open(path).with_context(|| format!("cannot open {}", path.display()))?;
        let options =
            LinearReaderOptions::default().with_validate_chunk_crcs(true).with_record_length_limit(LARGEST_RECORD);
        Ok(Reader {
            file,
            mcap: LinearReader::new_with_options(options),
            schemas: BTreeMap::new(),
            channels: BTreeMap::new(),
            payload: Vec::new(),
            metadata: Metadata { name: String::new(), metadata: BTreeMap::new() },
            node: None,
        })
    }

    /// Whose recording it is, once its first record was read.
    pub fn node(&self) -> Option<&NodeInfo> {
        self.node.as_ref()
    }

    /// Reads on. After [`Polled::Waiting`] it may be called again, to see whether the file grew.
    ///
    /// # Errors
    /// If the file cannot be read or is damaged; what came before is good.
    pub fn poll(&mut self) -> anyhow::Result<Polled<'_>> {
        loop {
            let Some(event) = self.mcap.next_event() else { return Ok(Polled::End) };
            let record = match event? {
                LinearReadEvent::ReadRequest(wanted) => {
                    let space = self.mcap.insert(wanted.clamp(READ_SIZE, LARGEST_READ));
                    let read = self.file.read(space)?;
                    if read == 0 {
                        return Ok(Polled::Waiting);
                    }
                    self.mcap.notify_read(read);
                    continue;
                }
                LinearReadEvent::Record { opcode, data } => parse_record(opcode, data)?,
            };
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
                    return Ok(self.found(Found::Message { channel, sequence, log_time }));
                }
                Record::Metadata(metadata) => {
                    self.node = NodeInfo::from_metadata(&metadata).or(self.node.take());
                    self.metadata = metadata;
                    return Ok(self.found(Found::Metadata));
                }
                _ => {}
            }
        }
    }

    fn found(&self, found: Found) -> Polled<'_> {
        match found {
            Found::Message { channel, sequence, log_time } => {
                let channel = &self.channels[&channel];
                Polled::Message(RawMessage { channel, sequence, log_time, data: &self.payload })
            }
            Found::Metadata => Polled::Metadata(&self.metadata),
        }
    }
}
