//! What a node did while it worked: an MCAP recording, and the Rerun view of it.

/// The recording of one node.
#[derive(Debug, Default)]
pub struct Recorder {}
