//! The recording of a node. It grows under `live/` while the node works, and becomes an object of the store when the
//! node has finished.

use std::path::{Path, PathBuf};

use crate::{
    digest::Digest,
    record::{NodeInfo, Recorder},
    run::{job::Job, runs},
    store::Key,
};

/// The finished recording of a node.
#[derive(Debug, Default)]
pub(super) struct Recorded {
    /// The canonical file and the digest of its messages; `None` where recording failed.
    pub(super) file: Option<(PathBuf, Digest)>,
    /// Seconds inside the recorder.
    pub(super) secs: f64,
    /// What went wrong.
    pub(super) warning: Option<String>,
}

/// Where the recording of a node grows, below the folder of the run.
pub(super) fn live_name(node: &str) -> String {
    format!("live/{}.mcap", runs::file_name(node))
}

/// Where the finished recording of a node is linked, below the folder of the run.
pub(super) fn link_name(node: &str) -> String {
    format!("{}.mcap", runs::file_name(node))
}

/// Starts the recording of a job. Of the pipeline, it names only the node.
pub(super) fn start(run_dir: &Path, job: &Job, key: &Key) -> Recorder {
    let info = NodeInfo {
        node: job.node.clone(),
        kind: job.work.kind.clone(),
        key: key.digest.to_string(),
        round: job.round.unwrap_or(0),
    };
    Recorder::create(&run_dir.join(live_name(&job.node)), &info)
}

/// Finishes a recording into the file `canonical`.
pub(super) fn finish(recorder: Recorder, canonical: &Path) -> Recorded {
    let finished = recorder.finish(canonical);
    Recorded {
        file: finished.path.zip(finished.messages_digest.map(Digest::from)),
        secs: finished.spent.as_secs_f64(),
        warning: finished.warning,
    }
}
