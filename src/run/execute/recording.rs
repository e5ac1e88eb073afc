//! A node's recording: grows under `live/` while the node works, and becomes an object when it has finished.

use std::path::{Path, PathBuf};

use crate::{
    digest::Digest,
    pipeline::Node,
    record::{NodeInfo, Recorder},
    run::{key::Key, runs},
};

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

/// Starts a node's recording. It carries the key, and nothing of the pipeline around the node but its name.
pub(super) fn start(run_dir: &Path, node: &Node, key: &Key) -> Recorder {
    let info = NodeInfo {
        node: node.name.clone(),
        kind: node.kind.name.to_owned(),
        key: key.digest.to_string(),
        round: node.round.unwrap_or(0),
    };
    Recorder::create(&run_dir.join(live_name(node)), &info)
}

/// Finishes it into the file `canonical`.
pub(super) fn finish(recorder: Recorder, canonical: &Path) -> Recorded {
    let finished = recorder.finish(canonical);
    Recorded {
        file: finished.path.zip(finished.messages_digest.map(Digest::from)),
        secs: finished.spent.as_secs_f64(),
        warning: finished.warning,
    }
}
