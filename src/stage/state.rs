//! The state of a long stage: a value that can be saved while the stage works and resumed by another process.

use anyhow::Context as _;

use crate::artifact::{Artifact, Files};

/// Everything that a stage's work so far has changed.
///
/// A stage that resumes from a saved state gives the bytes that it would have given without a stop. So the state holds
/// counters, parameters, optimisers and the exact position of every random stream that runs through several steps.
pub trait StageState: Sized {
    /// Writes the state as files.
    fn save(&self) -> anyhow::Result<Files>;

    /// Reads what `save` wrote.
    ///
    /// # Errors
    /// If a file is missing or holds something else.
    fn load(files: &Files) -> anyhow::Result<Self>;
}

/// Adds an artifact to the files of a state; `prefix` keeps its file names apart from others.
pub(super) fn put_artifact<A: Artifact>(files: &mut Files, prefix: &str, artifact: A) -> anyhow::Result<()> {
    for (name, content) in artifact.save()?.iter() {
        files.insert(format!("{prefix}.{name}"), content.clone());
    }
    Ok(())
}

/// Reads an artifact that [`put_artifact`] added.
pub(super) fn take_artifact<A: Artifact>(files: &Files, prefix: &str) -> anyhow::Result<A> {
    let own = files.iter().filter_map(|(name, content)| {
        let name = name.strip_prefix(prefix)?.strip_prefix('.')?;
        Some((name, content.clone()))
    });
    A::load(&own.collect()).with_context(|| format!("cannot read `{prefix}`"))
}
