//! Finds the run that a user names.

use std::path::{Path, PathBuf};

use super::{Found, list, pipeline_of};
use crate::run::marks::Marks;

/// Why a run cannot be found.
#[derive(Debug, thiserror::Error)]
pub enum FindError {
    /// There are no runs in this folder.
    #[error("there are no runs in {} yet", .0.display())]
    NoRuns(PathBuf),
    /// No run has this name.
    #[error("no run is called `{wanted}`")]
    Unknown {
        /// The name.
        wanted: String,
        /// Names that runs have: tags, pipelines and ids.
        known: Vec<String>,
    },
    /// There are not so many runs.
    #[error("`{wanted}` does not exist: there are only {count} runs of `{name}`")]
    TooOld {
        /// The name with `~` and a number.
        wanted: String,
        /// What comes before the `~`.
        name: String,
        /// How many runs it may mean.
        count: usize,
    },
    /// Several runs may be meant.
    #[error("{} runs {what} `{wanted}`, from {} to {}", found.len(), found.last().map_or("", String::as_str), found.first().map_or("", String::as_str))]
    Ambiguous {
        /// The name.
        wanted: String,
        /// `begin with`, or `have the tag`.
        what: &'static str,
        /// The ids of the runs, newest first.
        found: Vec<String>,
    },
    /// The folder of the runs cannot be read.
    #[error(transparent)]
    Unreadable(#[from] anyhow::Error),
}

/// Finds a run: `latest`, an id, a tag, the name of a pipeline (its newest run), or the beginning of an id. After
/// `latest` and the name of a pipeline, `~N` goes back by N runs.
///
/// # Errors
/// There is no such run, there are several, or the folder cannot be read.
pub fn find(runs: &Path, wanted: &str) -> Result<PathBuf, FindError> {
    let all = list(runs)?;
    if all.is_empty() {
        return Err(FindError::NoRuns(runs.to_owned()));
    }
    let (name, back) = match wanted.rsplit_once('~').map(|(name, back)| (name, back.parse())) {
        Some((name, Ok(back))) => (name, back),
        _ => (wanted, 0),
    };
    let is_whole = name == wanted && name != "latest";
    if is_whole && all.iter().any(|run| run.id == wanted) {
        return Ok(runs.join(wanted));
    }
    let tagged: Vec<&Found> = all.iter().filter(|run| is_whole && is_tagged(&runs.join(&run.id), wanted)).collect();
    if !tagged.is_empty() {
        return one(runs, wanted, "have the tag", &tagged);
    }
    // A run that has just started, or was killed before its first node worked, has nothing to show.
    let can_be_read = |run: &&Found| runs.join(&run.id).join("manifest.json").exists();
    let has_name = |run: &&Found| name == "latest" || pipeline_of(&runs.join(&run.id)).is_some_and(|it| it == name);
    let of_name = |run: &&Found| has_name(run) && can_be_read(run);
    if let Some(run) = all.iter().filter(of_name).nth(back) {
        return Ok(runs.join(&run.id));
    }
    let count = all.iter().filter(of_name).count();
    if count > 0 {
        return Err(FindError::TooOld { wanted: wanted.to_owned(), name: name.to_owned(), count });
    }
    let begins: Vec<&Found> = all.iter().filter(|run| run.id.starts_with(wanted)).collect();
    if begins.is_empty() {
        return Err(FindError::Unknown { wanted: wanted.to_owned(), known: names(runs, &all) });
    }
    one(runs, wanted, "begin with", &begins)
}

fn is_tagged(run_dir: &Path, tag: &str) -> bool {
    Marks::read(run_dir).is_ok_and(|marks| marks.tags.iter().any(|it| it == tag))
}

fn one(runs: &Path, wanted: &str, what: &'static str, found: &[&Found]) -> Result<PathBuf, FindError> {
    match found {
        [one] => Ok(runs.join(&one.id)),
        _ => {
            let found = found.iter().map(|run| run.id.clone()).collect();
            Err(FindError::Ambiguous { wanted: wanted.to_owned(), what, found })
        }
    }
}

/// Every name that finds a run: tags, pipelines, then ids.
fn names(runs: &Path, all: &[Found]) -> Vec<String> {
    let mut names: Vec<String> = vec!["latest".to_owned()];
    let tags = all.iter().flat_map(|run| Marks::read(&runs.join(&run.id)).unwrap_or_default().tags);
    let pipelines = all.iter().filter_map(|run| pipeline_of(&runs.join(&run.id)));
    for name in tags.chain(pipelines) {
        if !names.contains(&name) {
            names.push(name);
        }
    }
    names.extend(all.iter().map(|run| run.id.clone()));
    names
}
