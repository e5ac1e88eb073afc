//! What can still be read of a run whose manifest cannot, or that ended before it was written whole: every digest that
//! its files name.

use std::{collections::BTreeSet, fs, path::Path};

use crate::{digest::Digest, store::Entry};

/// The hexadecimal digits of a digest.
const DIGITS: usize = 64;

/// Digests that the files of a run name: keys, outputs, recordings and objects.
#[derive(Debug, Default)]
pub(super) struct Salvaged(BTreeSet<Digest>);

impl Salvaged {
    /// Reads the digests in the text of the manifest and of the events, and those that links lead to.
    pub(super) fn of(run_dir: &Path) -> Self {
        let mut found = BTreeSet::new();
        for name in ["manifest.json", "events.jsonl"] {
            found.extend(digests(&fs::read(run_dir.join(name)).unwrap_or_default()));
        }
        for item in fs::read_dir(run_dir).into_iter().flatten().flatten() {
            found.extend(fs::read_link(item.path()).ok().and_then(|target| object(&target)));
        }
        Self(found)
    }

    /// Whether a file of the run names this result, or a part of it.
    pub(super) fn names(&self, entry: &Entry) -> bool {
        entry.objects().chain([entry.key_digest, entry.output]).any(|digest| self.0.contains(&digest))
    }

    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

/// Every `b3:` and 64 hexadecimal digits in a text.
fn digests(text: &[u8]) -> impl Iterator<Item = Digest> {
    let long = text.windows(3 + DIGITS).filter(|window| window.starts_with(b"b3:"));
    long.filter_map(|window| std::str::from_utf8(window).ok()?.parse().ok())
}

/// The object that a link leads to: `…/objects/9f/86d0…`.
fn object(target: &Path) -> Option<Digest> {
    let [rest, prefix] = [target.file_name()?, target.parent()?.file_name()?];
    format!("b3:{}{}", prefix.to_str()?, rest.to_str()?).parse().ok()
}
