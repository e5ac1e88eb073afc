//! An entry says what a key made: the files, the recording and the metrics, with a check over itself.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs, io,
    path::{Path, PathBuf},
};

use anyhow::Context as _;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::{
    Store,
    durable::{Temporary, make_folder, sync_folder},
    objects::{Seen, Stat, Unusable},
};
use crate::{artifact::Files, digest::Digest, run::key::Key};

/// The format of an entry; raised when an older carl-pipe would misread it.
const FORMAT: u32 = 1;

/// What a key made.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Entry {
    format: u32,
    /// The key, readable.
    pub key: Value,
    /// The digest of the key.
    pub key_digest: Digest,
    /// The node that made it first.
    pub node: String,
    /// The run that made it first.
    pub run: String,
    /// The content digest of the output.
    pub output: Digest,
    /// The files of the output.
    pub files: Vec<FileRef>,
    /// What the node recorded; none where recording failed.
    pub recording: Option<RecordingRef>,
    /// Metrics by name.
    #[serde(rename = "figures")]
    pub metrics: BTreeMap<String, f64>,
    /// How long it took.
    pub secs: f64,
    /// How much of that the recorder took.
    pub recorder_secs: f64,
    /// True if there was a recording, but it is gone or damaged.
    #[serde(skip)]
    pub lost_recording: bool,
}

/// One file of an output.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FileRef {
    /// Its name in the artifact.
    pub name: String,
    /// Its bytes.
    pub object: Digest,
    /// The object as it was published.
    pub stat: Stat,
}

/// A node's recording.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RecordingRef {
    /// Its bytes.
    pub object: Digest,
    /// The digest of its messages, which outlives a change of compression.
    pub messages: Digest,
    /// The object as it was published.
    pub stat: Stat,
}

/// What a node made, not yet published.
#[derive(Debug)]
pub struct Draft<'a> {
    /// The key that made it.
    pub key: &'a Key,
    /// The node.
    pub node: &'a str,
    /// The run.
    pub run: &'a str,
    /// The output.
    pub files: &'a Files,
    /// The finished recording, to be taken over, and the digest of its messages.
    pub recording: Option<(&'a Path, Digest)>,
    /// Metrics by name.
    pub metrics: BTreeMap<String, f64>,
    /// How long it took.
    pub secs: f64,
    /// How much of that the recorder took.
    pub recorder_secs: f64,
}

/// What publishing did.
#[derive(Debug)]
pub struct Published {
    /// The entry that now counts.
    pub entry: Entry,
    /// Another output that the same key made: the kind is not deterministic. The first counts while it is whole.
    pub differs: Option<Digest>,
}

/// What the store has for a key.
#[derive(Debug)]
pub enum Found {
    /// A result whose objects are there and untouched.
    Hit(Box<Entry>),
    /// Nothing.
    Miss,
    /// An entry that cannot be used, and why.
    Unusable(String),
}

impl Store {
    /// Looks a key up, without reading any object that was not touched.
    ///
    /// # Errors
    /// What the system says.
    pub fn find(&self, key: Digest) -> anyhow::Result<Found> {
        let path = self.entry_path(key);
        let mut entry = match read_entry(&path, key)? {
            Ok(entry) => entry,
            Err(None) => return Ok(Found::Miss),
            Err(Some(why)) => {
                self.put_aside(&path);
                return Ok(Found::Unusable(why));
            }
        };
        let mut was_moved = false;
        for file in &mut entry.files {
            match self.look_at(file.object, file.stat)? {
                Seen::Same => {}
                Seen::Moved(stat) => (file.stat, was_moved) = (stat, true),
                Seen::Unusable(why) => return Ok(Found::Unusable(format!("its {} is {why}", file.name))),
            }
        }
        if let Some(recording) = &mut entry.recording {
            match self.look_at(recording.object, recording.stat)? {
                Seen::Same => {}
                Seen::Moved(stat) => (recording.stat, was_moved) = (stat, true),
                // The result stands without it.
                Seen::Unusable(_) => (entry.recording, entry.lost_recording) = (None, true),
            }
        }
        if was_moved && !entry.lost_recording {
            // Only saves the next look from reading; whether it succeeds does not matter.
            let _ = self.write_entry(&entry).and_then(|temporary| temporary.replace(&path));
        }
        Ok(Found::Hit(Box::new(entry)))
    }

    /// Reads the files of an output and verifies their bytes.
    ///
    /// # Errors
    /// What the system says; the inner error names a file that is gone or damaged.
    pub fn load(&self, entry: &Entry) -> anyhow::Result<Result<Files, (String, Unusable)>> {
        let mut files = Files::new();
        for file in &entry.files {
            match self.read_object(file.object)? {
                Ok(bytes) => files.insert(file.name.clone(), bytes),
                Err(why) => return Ok(Err((file.name.clone(), why))),
            };
        }
        Ok(Ok(files))
    }

    /// Publishes what a node made: first every object, made safe, then the entry that names them.
    ///
    /// # Errors
    /// What the system says; then nothing is published.
    pub fn publish(&self, draft: Draft<'_>) -> anyhow::Result<Published> {
        let mut entry = self.publish_objects(&draft)?;
        let path = self.entry_path(entry.key_digest);
        let folder = path.parent().expect("entries lie in folders").to_owned();
        make_folder(&folder)?;
        let temporary = self.write_entry(&entry)?;
        temporary.seal()?;
        if temporary.place(&path)? {
            sync_folder(&folder)?;
            return Ok(Published { entry, differs: None });
        }
        let first = read_entry(&path, entry.key_digest)?.ok();
        let differs = first.as_ref().map(|first| first.output).filter(|&output| output != entry.output);
        if differs.is_some()
            && let Found::Hit(first) = self.find(entry.key_digest)?
        {
            return Ok(Published { entry: *first, differs: Some(entry.output) });
        }
        // Equal results, or the first is damaged: ours replaces it, and keeps a recording that it may lack.
        if differs.is_none() && entry.recording.is_none() {
            entry.recording = first.and_then(|first| first.recording);
        }
        let temporary = self.write_entry(&entry)?;
        temporary.seal()?;
        temporary.replace(&path)?;
        sync_folder(&folder)?;
        Ok(Published { entry, differs })
    }

    fn publish_objects(&self, draft: &Draft<'_>) -> anyhow::Result<Entry> {
        let staged: Vec<_> =
            draft.files.values().map(|bytes| self.stage_bytes(bytes)).collect::<anyhow::Result<_>>()?;
        let recording =
            draft.recording.map(|(path, messages)| Ok::<_, anyhow::Error>((self.stage_file(path)?, messages)));
        let recording = recording.transpose()?;
        for object in staged.iter().chain(recording.as_ref().map(|(object, _)| object)) {
            object.seal()?;
        }
        let mut folders = BTreeSet::new();
        let mut files = Vec::new();
        for (name, object) in draft.files.keys().zip(staged) {
            let digest = object.digest;
            let (stat, folder) = object.place()?;
            folders.insert(folder);
            files.push(FileRef { name: name.clone(), object: digest, stat });
        }
        let recording = match recording {
            None => None,
            Some((object, messages)) => {
                let digest = object.digest;
                let (stat, folder) = object.place()?;
                folders.insert(folder);
                Some(RecordingRef { object: digest, messages, stat })
            }
        };
        folders.iter().try_for_each(|folder| sync_folder(folder))?;
        Ok(Entry {
            format: FORMAT,
            key: draft.key.json.clone(),
            key_digest: draft.key.digest,
            node: draft.node.to_owned(),
            run: draft.run.to_owned(),
            output: Digest::of_files(files.iter().map(|file| (file.name.as_str(), file.object))),
            files,
            recording,
            metrics: draft.metrics.clone(),
            secs: draft.secs,
            recorder_secs: draft.recorder_secs,
            lost_recording: false,
        })
    }

    /// Forgets what a key made, keeping its objects.
    ///
    /// # Errors
    /// What the system says.
    pub fn forget(&self, key: Digest) -> anyhow::Result<()> {
        let path = self.entry_path(key);
        match fs::remove_file(&path) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => {
                Err(error).with_context(|| format!("cannot remove {}", path.display()))
            }
            _ => Ok(()),
        }
    }

    /// The entry of a key, whatever became of its objects.
    ///
    /// # Errors
    /// What the system says.
    pub fn entry(&self, key: Digest) -> anyhow::Result<Option<Entry>> {
        Ok(read_entry(&self.entry_path(key), key)?.ok())
    }

    fn entry_path(&self, key: Digest) -> PathBuf {
        let hex = key.hex();
        self.root().join("keys").join(&hex[..2]).join(format!("{}.json", &hex[2..]))
    }

    fn write_entry(&self, entry: &Entry) -> anyhow::Result<Temporary> {
        let body = format!("\"entry\":{}}}\n", serde_json::to_string(entry).context("an entry is plain data")?);
        let text = format!("{}{body}", head(Digest::of_bytes(body.as_bytes())));
        Temporary::write(&self.temporary(), text.as_bytes())
    }
}

/// How an entry begins: its check, over every byte that follows.
fn head(check: Digest) -> String {
    format!("{{\"check\":\"{check}\",\n")
}

/// Reads an entry; the inner error is empty where there is none, else says why it cannot be used.
fn read_entry(path: &Path, key: Digest) -> anyhow::Result<Result<Entry, Option<String>>> {
    #[derive(Deserialize)]
    struct OnDisk {
        entry: Entry,
    }
    let text = match fs::read(path) {
        Ok(text) => text,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Err(None)),
        Err(error) => return Err(error).with_context(|| format!("cannot read {}", path.display())),
    };
    let head_len = head(key).len();
    let is_whole = text.len() > head_len && text.starts_with(head(Digest::of_bytes(&text[head_len..])).as_bytes());
    if !is_whole {
        return Ok(Err(Some("its entry is damaged".to_owned())));
    }
    let entry = match serde_json::from_slice::<OnDisk>(&text) {
        Ok(on_disk) if on_disk.entry.format == FORMAT => on_disk.entry,
        _ => return Ok(Err(Some("its entry is of another format".to_owned()))),
    };
    if entry.key_digest == key { Ok(Ok(entry)) } else { Ok(Err(Some("its entry is of another key".to_owned()))) }
}
