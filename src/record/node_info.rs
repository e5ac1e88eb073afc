//! The metadata of a recording: which node made it.

use mcap::records::Metadata;

/// Name of the metadata record.
const RECORD_NAME: &str = "carl.node";

/// The node that made a recording.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct NodeInfo {
    /// The node's name, such as `represent@0`.
    pub node: String,
    /// The node's stage kind.
    pub kind: String,
    /// The node's key.
    pub key: String,
    /// The round of the loop; 0 outside of a loop.
    pub round: u32,
}

impl NodeInfo {
    pub(super) fn to_metadata(&self) -> Metadata {
        let NodeInfo { node, kind, key, round } = self;
        let pairs =
            [("node", node.clone()), ("kind", kind.clone()), ("key", key.clone()), ("round", round.to_string())];
        Metadata { name: RECORD_NAME.to_owned(), metadata: pairs.map(|(name, value)| (name.to_owned(), value)).into() }
    }

    /// `None` if the record is not the one that [`NodeInfo::to_metadata`] makes.
    pub(super) fn from_metadata(metadata: &Metadata) -> Option<NodeInfo> {
        let value = |name: &str| metadata.metadata.get(name).cloned().unwrap_or_default();
        (metadata.name == RECORD_NAME).then(|| NodeInfo {
            node: value("node"),
            kind: value("kind"),
            key: value("key"),
            round: value("round").parse().unwrap_or(0),
        })
    }
}
