//! The runs that lie in a folder, in their order.

use std::{
    fs::{self, File},
    io::{self, Read as _},
    path::Path,
};

use anyhow::Context as _;

use super::numbers::{self, Numbers};
use crate::run::{
    events::Event,
    manifest::{Manifest, Unreadable},
};

/// A run that lies in the folder of the runs. A run is greater than those that started before it.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Found {
    /// Its number. `None` for runs from before runs had one; by their ids, they come before all others.
    pub number: Option<u64>,
    /// Its id, which is the name of its folder.
    pub id: String,
}

/// All runs, newest first. Folders that no run made are left out.
///
/// # Errors
/// The folder cannot be read.
pub fn list(runs: &Path) -> anyhow::Result<Vec<Found>> {
    list_with(runs, &numbers::read(runs))
}

/// All runs, newest first. The files of a run are read only if `numbers` lacks the run.
pub(super) fn list_with(runs: &Path, numbers: &Numbers) -> anyhow::Result<Vec<Found>> {
    let items = match fs::read_dir(runs) {
        Ok(items) => items,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err(error).with_context(|| format!("cannot read {}", runs.display())),
    };
    let mut found = Vec::new();
    for item in items {
        let item = item.with_context(|| format!("cannot read {}", runs.display()))?;
        let id = item.file_name().into_string().ok().filter(|name| is_id(name));
        let is_folder = item.file_type().is_ok_and(|kind| kind.is_dir());
        let Some(id) = id.filter(|_| is_folder) else { continue };
        match numbers.get(&id) {
            Some(&number) => found.push(Found { number: Some(number), id }),
            None if is_of_a_run(&item.path()) => found.push(Found { number: number(&item.path()), id }),
            None => {}
        }
    }
    found.sort_unstable_by(|one, other| other.cmp(one));
    Ok(found)
}

/// Whether a run has left a file in a folder.
fn is_of_a_run(run_dir: &Path) -> bool {
    ["manifest.json", "events.jsonl", "alive"].iter().any(|name| run_dir.join(name).exists())
}

/// The number of a run as the first bytes of its manifest have it, or those of its events where there is no manifest.
/// The check of the manifest is not made, since that would read every manifest whole.
fn number(run_dir: &Path) -> Option<u64> {
    let of_manifest =
        |text: String| text.lines().nth(1)?.trim().strip_prefix("\"number\": ")?.trim_end_matches(',').parse().ok();
    let number = first_bytes(&run_dir.join("manifest.json")).and_then(of_manifest);
    let number = number.or_else(|| match started(run_dir)? {
        Event::RunStarted { number, .. } => number,
        _ => None,
    });
    number.filter(|&number| number < numbers::MOST)
}

/// The pipeline of a run as its events have it.
pub fn pipeline_of(run_dir: &Path) -> Option<String> {
    match started(run_dir)? {
        Event::RunStarted { pipeline, .. } => Some(pipeline),
        _ => None,
    }
}

/// The first event of a run.
fn started(run_dir: &Path) -> Option<Event> {
    serde_json::from_str(first_bytes(&run_dir.join("events.jsonl"))?.lines().next()?).ok()
}

/// The beginning of a file, more than its first lines need.
fn first_bytes(path: &Path) -> Option<String> {
    let mut bytes = Vec::new();
    File::open(path).ok()?.take(1024).read_to_end(&mut bytes).ok()?;
    Some(String::from_utf8_lossy(&bytes).into_owned())
}

/// The manifests of all runs, newest first, or why one cannot be read.
///
/// # Errors
/// The folder of the runs cannot be read.
pub fn manifests(runs: &Path) -> anyhow::Result<impl Iterator<Item = (Found, Result<Manifest, Unreadable>)>> {
    let folder = runs.to_owned();
    Ok(list(runs)?.into_iter().map(move |found| {
        let manifest = Manifest::read(&folder.join(&found.id));
        (found, manifest)
    }))
}

/// Whether a name has the shape of an id.
pub(in crate::run) fn is_id(name: &str) -> bool {
    let widths: Vec<usize> = name.split('-').map(str::len).collect();
    let is_hex = name.chars().all(|c| c == '-' || c.is_ascii_digit() || matches!(c, 'a'..='f'));
    is_hex && widths == [8, 6, 3, 4] && name[..19].chars().all(|c| c == '-' || c.is_ascii_digit())
}

#[cfg(test)]
mod tests {
    use super::is_id;

    #[test]
    fn an_id_has_a_shape_of_its_own() {
        assert!(is_id("20260802-143501-123-007f"));
        for other in ["latest", "20260802", "20260802-143501-123-007g", "20260802-14350a-123-007f", ".latest-2026", "ä"]
        {
            assert!(!is_id(other), "{other}");
        }
    }
}
