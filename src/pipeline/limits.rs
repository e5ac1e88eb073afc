//! Sizes beyond which a file is refused, so that reading it neither fills the memory nor outgrows the stack.

/// Bytes of a file.
pub(crate) const MAX_BYTES: usize = 4 << 20;
/// Parts of a dotted key or path.
pub(crate) const MAX_PARTS: usize = 32;
/// Lists and tables inside each other.
pub(crate) const MAX_DEPTH: usize = 48;
/// Nodes of a graph, and values of an axis of the matrix.
pub(crate) const MAX_NODES: usize = 100_000;
/// Connections between stages and rounds.
pub(crate) const MAX_CONNECTIONS: usize = 10_000_000;
