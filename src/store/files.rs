//! The files of a result, in memory or on disk.

use std::{
    borrow::Cow,
    collections::BTreeMap,
    fs::{self, File},
    io::{self, BufReader, Cursor, Read, Seek, SeekFrom},
    path::PathBuf,
};

use super::{
    Result,
    error::{OrIo as _, Problem},
};

/// What a file holds.
#[derive(Debug, Clone)]
pub enum Content {
    /// The bytes themselves.
    Bytes(Vec<u8>),
    /// The bytes in parts that follow each other, so that large tensors become a file without a copy in memory.
    Parts(Vec<Vec<u8>>),
    /// A file that holds the bytes. A store that publishes it takes the file over; an input that was loaded is the
    /// store's own file, which must only be read.
    File(PathBuf),
}

impl Content {
    /// The bytes; read from disk where they lie in a file.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn bytes(&self) -> Result<Cow<'_, [u8]>> {
        match self {
            Self::Bytes(bytes) => Ok(Cow::Borrowed(bytes)),
            Self::Parts(parts) => Ok(Cow::Owned(parts.concat())),
            Self::File(path) => fs::read(path).map(Cow::Owned).or_io(|| format!("cannot read {}", path.display())),
        }
    }
}

impl Content {
    /// The number of bytes.
    ///
    /// # Errors
    /// The size of the file cannot be read.
    pub fn size(&self) -> Result<u64> {
        Ok(match self {
            Self::Bytes(bytes) => bytes.len() as u64,
            Self::Parts(parts) => parts.iter().map(|part| part.len() as u64).sum(),
            Self::File(path) => fs::metadata(path).or_io(|| format!("cannot read {}", path.display()))?.len(),
        })
    }

    /// Reads the bytes from any position on, without holding all of them in memory.
    ///
    /// # Errors
    /// The file cannot be opened.
    pub fn reader(&self) -> Result<Box<dyn ReadSeek + '_>> {
        Ok(match self {
            Self::Bytes(bytes) => Box::new(Cursor::new(&bytes[..])),
            Self::Parts(parts) => Box::new(PartsReader { parts, at: 0 }),
            Self::File(path) => {
                Box::new(BufReader::new(File::open(path).or_io(|| format!("cannot read {}", path.display()))?))
            }
        })
    }
}

/// Contents are equal if their bytes are; files on disk are equal if they are the same file.
impl PartialEq for Content {
    fn eq(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::File(one), Self::File(other)) => one == other,
            (Self::File(_), _) | (_, Self::File(_)) => false,
            _ => self.bytes().ok() == other.bytes().ok(),
        }
    }
}

impl Eq for Content {}

/// Bytes to read from any position on.
pub trait ReadSeek: Read + Seek {}

impl<T: Read + Seek> ReadSeek for T {}

/// Reads parts that follow each other.
struct PartsReader<'a> {
    parts: &'a [Vec<u8>],
    at: u64,
}

impl Read for PartsReader<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let mut begin = 0;
        for part in self.parts {
            let end = begin + part.len() as u64;
            if self.at < end {
                let count = (&part[(self.at - begin) as usize..]).read(buffer)?;
                self.at += count as u64;
                return Ok(count);
            }
            begin = end;
        }
        Ok(0)
    }
}

impl Seek for PartsReader<'_> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let end: u64 = self.parts.iter().map(|part| part.len() as u64).sum();
        let target = match to {
            SeekFrom::Start(at) => Some(at),
            SeekFrom::End(by) => end.checked_add_signed(by),
            SeekFrom::Current(by) => self.at.checked_add_signed(by),
        };
        self.at = target.ok_or(io::ErrorKind::InvalidInput)?;
        Ok(self.at)
    }
}

impl From<Vec<u8>> for Content {
    fn from(bytes: Vec<u8>) -> Self {
        Self::Bytes(bytes)
    }
}

/// The files of one result by name, in the order of their names.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Files(BTreeMap<String, Content>);

impl Files {
    /// No files.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a file, or replaces the one of that name.
    pub fn insert(&mut self, name: impl Into<String>, content: impl Into<Content>) {
        self.0.insert(name.into(), content.into());
    }

    /// The content of a file.
    pub fn get(&self, name: &str) -> Option<&Content> {
        self.0.get(name)
    }

    /// The bytes of a file.
    ///
    /// # Errors
    /// There is no such file, or it cannot be read.
    pub fn bytes(&self, name: &str) -> Result<Cow<'_, [u8]>> {
        match self.get(name) {
            Some(content) => content.bytes(),
            None => Err(Problem::Gone.of(name)),
        }
    }

    /// Every file, in the order of the names.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &Content)> {
        self.0.iter().map(|(name, content)| (name.as_str(), content))
    }

    /// The names of all files, in order.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.0.keys().map(String::as_str)
    }

    /// Takes a file out.
    pub fn remove(&mut self, name: &str) -> Option<Content> {
        self.0.remove(name)
    }

    /// How many files there are.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether there are no files.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

impl<N: Into<String>, C: Into<Content>, const COUNT: usize> From<[(N, C); COUNT]> for Files {
    fn from(files: [(N, C); COUNT]) -> Self {
        files.into_iter().collect()
    }
}

impl<N: Into<String>, C: Into<Content>> FromIterator<(N, C)> for Files {
    fn from_iter<I: IntoIterator<Item = (N, C)>>(files: I) -> Self {
        Self(files.into_iter().map(|(name, content)| (name.into(), content.into())).collect())
    }
}
