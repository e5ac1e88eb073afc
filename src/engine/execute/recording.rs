//! A node's recording: grows under `live/` while the node works, and becomes an object when it has finished.

use std::path::{Path, PathBuf};

use crate::{digest::Digest, engine::{key::Key, runs}, pipeline::Node, record::Recorder};

/// What is left of a recording when its node has finished.
#[derive(Debug, Default)]
pub(super) struct Recorded {
    /// The canonical file and the digest of its messages; none where recording failed.
    pub(super) file: Option<(PathBuf, Digest)>,
    /// Time inside the recorder.
    pub(super) secs: f64,
    /// What went wrong.
    pub(super) warning: Option<String>,
}

/// Where a node's recording grows, below the folder of the run.
pub(super) fn live_name(node: &Node) -> String {
    format!("live/{}.mcap", runs::file_name(&node.name))
}

/// Where a finished recording is linked, below the folder of the run.
pub(super) fn link_name(node: &str) -> String {
    format!("{}.mcap", runs::file_name(node))
}

/// Starts a node's recording.
pub(super) fn start(_run_dir: &Path, _node: &Node, _key: &Key) -> Recorder {
    Recorder::default()
}

/// Finishes it into the file `canonical`.
pub(super) fn finish(_recorder: Recorder, _canonical: &Path) -> Recorded {
    Recorded::default()
}
