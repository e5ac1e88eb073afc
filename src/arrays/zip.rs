//! ZIP archives as NumPy writes them: entries are stored or deflated, and may be larger than 4 GiB.

use std::io::{self, BufReader, Read, Seek, SeekFrom, Write};

use anyhow::{Context as _, bail, ensure};
use flate2::{Crc, read::DeflateDecoder};

const LOCAL: u32 = 0x0403_4b50;
const CENTRAL: u32 = 0x0201_4b50;
const END: u32 = 0x0605_4b50;
const END_64: u32 = 0x0606_4b50;
const END_64_LOCATOR: u32 = 0x0706_4b50;
/// Says that a length or an offset stands in the field of 64 bits.
const WIDE: u64 = 0xffff_ffff;
/// The most bytes after the last entry in which the end is looked for: a comment is no longer.
const LONGEST_END: u64 = (1 << 16) + 22;
/// The most entries that are read.
const MOST_ENTRIES: u64 = 100_000;

/// An entry of an archive.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Entry {
    pub(super) name: String,
    method: u16,
    checksum: u32,
    packed: u64,
    /// Bytes once unpacked.
    pub(super) size: u64,
    offset: u64,
}

/// Reads the table of contents.
pub(super) fn entries(file: &mut (impl Read + Seek)) -> anyhow::Result<Vec<Entry>> {
    let length = file.seek(SeekFrom::End(0))?;
    let tail_at = length.saturating_sub(LONGEST_END);
    file.seek(SeekFrom::Start(tail_at))?;
    let mut tail = Vec::new();
    file.take(LONGEST_END).read_to_end(&mut tail)?;
    let is_end = |at: &usize| tail[*at..].starts_with(&END.to_le_bytes());
    let end = (0..tail.len().saturating_sub(21)).rev().find(is_end).context("not a ZIP archive")?;
    let (mut count, mut size, mut offset) =
        (u64::from(u16_at(&tail, end + 10)?), u64::from(u32_at(&tail, end + 12)?), u64::from(u32_at(&tail, end + 16)?));
    let locator = end.checked_sub(20).filter(|&at| u32_at(&tail, at).is_ok_and(|word| word == END_64_LOCATOR));
    if let Some(locator) = locator {
        file.seek(SeekFrom::Start(u64_at(&tail, locator + 8)?))?;
        let mut wide = [0; 56];
        file.read_exact(&mut wide)?;
        ensure!(u32_at(&wide, 0)? == END_64, "the end of the ZIP archive is damaged");
        (count, size, offset) = (u64_at(&wide, 32)?, u64_at(&wide, 40)?, u64_at(&wide, 48)?);
    }
    ensure!(count <= MOST_ENTRIES && size <= length && offset <= length, "the end of the ZIP archive is damaged");
    file.seek(SeekFrom::Start(offset))?;
    let mut table = Vec::new();
    file.take(size).read_to_end(&mut table)?;
    let (mut found, mut at) = (Vec::new(), 0);
    for _ in 0..count {
        let (entry, next) = entry(&table, at).context("the table of the ZIP archive is damaged")?;
        found.push(entry);
        at = next;
    }
    Ok(found)
}

/// The entry at a place of the table, and where the next one begins.
fn entry(table: &[u8], at: usize) -> anyhow::Result<(Entry, usize)> {
    ensure!(u32_at(table, at)? == CENTRAL, "no entry");
    let length = |at| u16_at(table, at).map(usize::from);
    let (name_length, extra_length, comment_length) = (length(at + 28)?, length(at + 30)?, length(at + 32)?);
    let name = table.get(at + 46..at + 46 + name_length).context("too short")?;
    let extra_at = at + 46 + name_length;
    let extra = table.get(extra_at..extra_at + extra_length).context("too short")?;
    let narrow = |at| u32_at(table, at).map(u64::from);
    let (mut packed, mut size, mut offset) = (narrow(at + 20)?, narrow(at + 24)?, narrow(at + 42)?);
    let mut wide = wide_field(extra).unwrap_or_default();
    for value in [&mut size, &mut packed, &mut offset] {
        if *value == WIDE {
            *value = u64_at(wide, 0)?;
            wide = &wide[8..];
        }
    }
    let (method, checksum) = (u16_at(table, at + 10)?, u32_at(table, at + 16)?);
    let name = String::from_utf8_lossy(name).into_owned();
    Ok((Entry { name, method, checksum, packed, size, offset }, extra_at + extra_length + comment_length))
}

/// The field with numbers of 64 bits.
fn wide_field(mut extra: &[u8]) -> Option<&[u8]> {
    loop {
        let (kind, length) = (u16_at(extra, 0).ok()?, usize::from(u16_at(extra, 2).ok()?));
        let field = extra.get(4..4 + length)?;
        if kind == 1 {
            return Some(field);
        }
        extra = &extra[4 + length..];
    }
}

impl Entry {
    /// Reads the bytes and compares them with their checksum.
    pub(super) fn read(&self, file: &mut (impl Read + Seek)) -> anyhow::Result<Vec<u8>> {
        file.seek(SeekFrom::Start(self.offset))?;
        let mut head = [0; 30];
        file.read_exact(&mut head)?;
        ensure!(u32_at(&head, 0)? == LOCAL, "`{}` is not where the table of the ZIP archive says", self.name);
        let skipped = u64::from(u16_at(&head, 26)?) + u64::from(u16_at(&head, 28)?);
        file.seek(SeekFrom::Current(skipped as i64))?;
        let packed = BufReader::new(file.take(self.packed));
        let mut bytes = Vec::new();
        match self.method {
            0 => packed.take(self.size).read_to_end(&mut bytes)?,
            8 => DeflateDecoder::new(packed).take(self.size).read_to_end(&mut bytes)?,
            other => bail!("`{}` is packed by method {other}; write it with numpy.savez", self.name),
        };
        let mut checksum = Crc::new();
        checksum.update(&bytes);
        let is_whole = bytes.len() as u64 == self.size && checksum.sum() == self.checksum;
        ensure!(is_whole, "`{}` is damaged: its checksum is another", self.name);
        Ok(bytes)
    }
}

/// Writes an archive whose entries are stored as they are.
pub(super) struct Writer<W: Write> {
    file: W,
    at: u64,
    table: Vec<u8>,
    count: u64,
}

impl<W: Write> Writer<W> {
    pub(super) fn new(file: W) -> Self {
        Self { file, at: 0, table: Vec::new(), count: 0 }
    }

    /// Adds an entry whose bytes come in parts.
    pub(super) fn add(&mut self, name: &str, parts: &[&[u8]]) -> io::Result<()> {
        let mut checksum = Crc::new();
        parts.iter().for_each(|part| checksum.update(part));
        let size: u64 = parts.iter().map(|part| part.len() as u64).sum();
        let offset = self.at;
        // Version 4.5, which has 64 bits; no flags; stored; 1 January 1980.
        let shared = [&45_u16.to_le_bytes()[..], &[0; 6], &[0x21, 0], &checksum.sum().to_le_bytes()].concat();
        let narrow = [&(WIDE as u32).to_le_bytes()[..]; 2].concat();
        let name_length = (name.len() as u16).to_le_bytes();
        let sizes = [size.to_le_bytes(), size.to_le_bytes()].concat();
        let field =
            |numbers: &[u8]| [&1_u16.to_le_bytes()[..], &(numbers.len() as u16).to_le_bytes(), numbers].concat();
        let extra = field(&sizes);
        let head = [&LOCAL.to_le_bytes()[..], &shared, &narrow, &name_length, &(extra.len() as u16).to_le_bytes()];
        self.write(&[&head.concat(), name.as_bytes(), &extra])?;
        self.write(parts)?;
        let extra = field(&[&sizes[..], &offset.to_le_bytes()].concat());
        let ends = [&name_length[..], &(extra.len() as u16).to_le_bytes(), &[0; 10], &(WIDE as u32).to_le_bytes()];
        let head = [&CENTRAL.to_le_bytes()[..], &45_u16.to_le_bytes(), &shared, &narrow, &ends.concat()];
        self.table.extend([&head.concat(), name.as_bytes(), &extra].concat());
        self.count += 1;
        Ok(())
    }

    /// Writes the table of contents.
    pub(super) fn finish(mut self) -> io::Result<W> {
        let (offset, size, count) = (self.at, self.table.len() as u64, self.count);
        let table = std::mem::take(&mut self.table);
        let version = [45_u16.to_le_bytes(); 2].concat();
        let numbers = [count, count, size, offset].map(u64::to_le_bytes).concat();
        let wide = [&END_64.to_le_bytes()[..], &44_u64.to_le_bytes(), &version, &[0; 8], &numbers];
        let place = (offset + size).to_le_bytes();
        let locator = [&END_64_LOCATOR.to_le_bytes()[..], &[0; 4], &place, &1_u32.to_le_bytes()];
        let end = [&END.to_le_bytes()[..], &[0; 4], &[0xff; 12], &[0; 2]];
        self.write(&[&table, &wide.concat(), &locator.concat(), &end.concat()])?;
        self.file.flush()?;
        Ok(self.file)
    }

    fn write(&mut self, parts: &[&[u8]]) -> io::Result<()> {
        for part in parts {
            self.file.write_all(part)?;
            self.at += part.len() as u64;
        }
        Ok(())
    }
}

fn u16_at(bytes: &[u8], at: usize) -> anyhow::Result<u16> {
    number(bytes, at).map(u16::from_le_bytes)
}

fn u32_at(bytes: &[u8], at: usize) -> anyhow::Result<u32> {
    number(bytes, at).map(u32::from_le_bytes)
}

fn u64_at(bytes: &[u8], at: usize) -> anyhow::Result<u64> {
    number(bytes, at).map(u64::from_le_bytes)
}

fn number<const BYTES: usize>(bytes: &[u8], at: usize) -> anyhow::Result<[u8; BYTES]> {
    let found = at.checked_add(BYTES).and_then(|end| bytes.get(at..end));
    Ok(found.context("too short")?.try_into()?)
}
