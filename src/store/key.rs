//! The name of a result.

use serde_json::Value;

use crate::digest::Digest;

/// The name of a result: readable JSON, and the digest of that JSON.
#[derive(Debug, Clone, PartialEq)]
pub struct Key {
    /// Everything that can change the result.
    pub json: Value,
    /// The digest of `json`.
    pub digest: Digest,
}

impl Key {
    /// The key that this JSON spells out.
    pub fn of_json(json: Value) -> Self {
        Self { digest: Digest::of_json(&json), json }
    }
}
