//! The files that nodes name, such as a user's own program. A run keeps copies of the small ones, so that an edit while
//! it works changes nothing, and a replay finds them.

use std::{
    collections::BTreeSet,
    fs,
    path::{Path, PathBuf},
};

use anyhow::{Context as _, ensure};

use crate::{digest::Digest, pipeline::NodeFile};

/// The largest file that a run keeps a copy of.
const KEPT: u64 = 16 << 20;

/// The files that one node names.
#[derive(Debug, Clone, Copy)]
pub(super) struct NamedFiles<'a> {
    /// The folder of the run.
    pub(super) run_dir: &'a Path,
    /// Where the files lay when the run was planned.
    pub(super) files: &'a [NodeFile],
}

impl NamedFiles<'_> {
    /// The path of a file that has this content now.
    pub(super) fn verified(&self, content: Digest) -> anyhow::Result<PathBuf> {
        let copy = kept(self.run_dir, content);
        let named = self.files.iter().find(|file| file.content == content).map(|file| &file.place);
        let place = if copy.exists() { copy } else { named.context("the node names no such file")?.clone() };
        let read = || format!("cannot read {}", place.display());
        let found = Digest::of_path(&place).with_context(read)?;
        ensure!(found == content, "{} has changed since the run was planned", place.display());
        Ok(place)
    }
}

/// Where a run keeps the copy of a file.
pub(super) fn kept(run_dir: &Path, content: Digest) -> PathBuf {
    run_dir.join("files").join(content.hex())
}

/// Copies small files into the folder of a run. A copy that fails, or is not what was planned, is no copy: the node that
/// needs the file then reads the file itself, and says what is wrong.
pub(super) fn keep<'a>(run_dir: &Path, files: impl Iterator<Item = &'a NodeFile>) {
    let mut seen = BTreeSet::new();
    for file in files.filter(|file| seen.insert(file.content)) {
        let is_small = fs::metadata(&file.place).is_ok_and(|meta| meta.is_file() && meta.len() <= KEPT);
        let Some(bytes) = is_small.then(|| fs::read(&file.place).ok()).flatten() else { continue };
        let copy = kept(run_dir, file.content);
        if Digest::of_bytes(&bytes) == file.content && fs::create_dir_all(run_dir.join("files")).is_ok() {
            // Written under the final name at once: a copy is verified when it is read.
            _ = fs::write(copy, bytes);
        }
    }
}
