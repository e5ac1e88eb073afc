//! An entry: what a key made, with a digest over the entry's own text.

use std::{collections::BTreeMap, io, path::Path};

use serde::{Deserialize, Serialize, de::IgnoredAny};
use serde_json::Value;

use super::{
    Files, Key,
    sealed::{self, Seal},
};
use crate::digest::Digest;

/// The format of an entry. Raise it when an older carl-pipe would misread an entry.
const FORMAT: u32 = 1;

/// What a key made.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Entry {
    format: u32,
    /// Where earlier versions kept the readable key.
    #[serde(default, rename = "key", skip_serializing)]
    earlier_key: IgnoredAny,
    /// The digest of the key.
    pub key_digest: Digest,
    /// The node that made the result first.
    pub node: String,
    /// The run that made the result first.
    pub run: String,
    /// The content digest of the output.
    pub output: Digest,
    /// The files of the output.
    pub files: Vec<FileRef>,
    /// What the node recorded; `None` where recording failed.
    pub recording: Option<RecordingRef>,
    /// Metrics by name.
    #[serde(rename = "figures")]
    pub metrics: BTreeMap<String, f64>,
    /// Seconds that the node worked.
    pub secs: f64,
    /// Seconds of these that the recorder took.
    pub recorder_secs: f64,
    /// Whether a look-up found the recording missing or damaged.
    #[serde(skip)]
    pub lost_recording: bool,
}

/// One file of an output.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FileRef {
    /// The name of the file in the output.
    pub name: String,
    /// The digest of its bytes.
    pub object: Digest,
    /// The object's file when it was published.
    pub stat: Stat,
}

/// The recording of a node.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RecordingRef {
    /// The digest of its bytes.
    pub object: Digest,
    /// The digest of its messages, which stays when the compression changes.
    pub messages: Digest,
    /// The object's file when it was published.
    pub stat: Stat,
}

/// Tells an untouched file from a touched one without reading it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Stat {
    /// Bytes.
    pub size: u64,
    /// When the bytes were last written.
    pub mtime_ns: i64,
    /// When the file or its inode last changed. No tool can set this time back.
    pub ctime_ns: i64,
    /// The number of the file in its file system.
    pub inode: u64,
}

/// A result that is not published yet.
#[derive(Debug)]
pub struct NewEntry<'a> {
    /// The key that made it.
    pub key: &'a Key,
    /// The node that made it.
    pub node: &'a str,
    /// The run that made it.
    pub run: &'a str,
    /// The output.
    pub files: &'a Files,
    /// The finished recording. The store takes its file over.
    pub recording: Option<NewRecording<'a>>,
    /// Metrics by name.
    pub metrics: BTreeMap<String, f64>,
    /// Seconds that the node worked.
    pub secs: f64,
    /// Seconds of these that the recorder took.
    pub recorder_secs: f64,
}

/// A recording that is not published yet.
#[derive(Debug, Clone, Copy)]
pub struct NewRecording<'a> {
    /// Its file.
    pub file: &'a Path,
    /// The digest of its messages.
    pub messages: Digest,
}

impl Entry {
    /// The entry of a result whose objects are in place.
    pub(super) fn new(new: &NewEntry<'_>, files: Vec<FileRef>, recording: Option<RecordingRef>) -> Self {
        Self {
            format: FORMAT,
            earlier_key: IgnoredAny,
            key_digest: new.key.digest,
            node: new.node.to_owned(),
            run: new.run.to_owned(),
            output: Digest::of_files(files.iter().map(|file| (file.name.as_str(), file.object))),
            files,
            recording,
            metrics: new.metrics.clone(),
            secs: new.secs,
            recorder_secs: new.recorder_secs,
            lost_recording: false,
        }
    }

    /// The objects that it names: those of its files, and its recording.
    pub fn objects(&self) -> impl Iterator<Item = Digest> + '_ {
        self.files.iter().map(|file| file.object).chain(self.recording.iter().map(|recording| recording.object))
    }

    /// The entry as a store keeps it: a line with the digest of all that follows, then the readable key and the entry. The
    /// key is for people. A look-up skips it.
    pub(super) fn to_text(&self, key: &Value) -> io::Result<String> {
        let body = format!("\"key\":{key},\n\"entry\":{}}}\n", serde_json::to_string(self)?);
        Ok(sealed::with_head(&body))
    }

    /// The readable key in what [`Entry::to_text`] wrote; null where there is none.
    pub(super) fn key_in(text: &[u8]) -> Value {
        let mut json: Value = serde_json::from_slice(text).unwrap_or_default();
        if json["key"].is_null() { json["entry"]["key"].take() } else { json["key"].take() }
    }

    /// Reads what [`Entry::to_text`] wrote for a key, or says why it cannot be used.
    pub(super) fn from_text(text: &[u8], key: Digest) -> Result<Self, EntryFault> {
        if sealed::check(text) != Seal::Whole {
            return Err(EntryFault::Damaged);
        }
        let mut lines = text.split(|&byte| byte == b'\n');
        let entry = lines.find_map(|line| line.strip_prefix(b"\"entry\":")).unwrap_or_default();
        // The brace that closes the whole text follows the entry, and is not read.
        match Self::deserialize(&mut serde_json::Deserializer::from_slice(entry)) {
            Ok(entry) if entry.format != FORMAT => Err(EntryFault::OtherFormat),
            Ok(entry) if entry.key_digest != key => Err(EntryFault::OtherKey),
            Ok(entry) => Ok(entry),
            Err(_) => Err(EntryFault::OtherFormat),
        }
    }
}

/// Why the text of an entry cannot be used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub(super) enum EntryFault {
    /// The text is not what was written.
    #[error("its entry is damaged")]
    Damaged,
    /// Another carl-pipe wrote it.
    #[error("its entry is of another format")]
    OtherFormat,
    /// It lies in the place of another entry.
    #[error("its entry is of another key")]
    OtherKey,
}
