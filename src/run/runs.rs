//! The folders of runs: their ids, their order, how to find them, and links in them.
//!
//! The order of runs is the order of their numbers. A folder is named after the time at which its run started, for
//! people; clocks go wrong, so no decision is taken by that name.

#![allow(clippy::disallowed_methods, reason = "a time names the folder of a run; no key or result holds one")]

mod find;
mod list;
mod numbers;

use std::{
    fs::{self, File},
    io,
    os::unix::fs::symlink,
    path::{Path, PathBuf},
    time::{SystemTime, UNIX_EPOCH},
};

use anyhow::Context as _;

use super::{
    alive,
    strays::{FRESH_LINK, FRESH_RUN},
    utc,
};
use crate::failpoint::failpoint;

pub use find::{FindError, find};
pub(super) use list::is_id;
pub use list::{Found, list, manifests, pipeline_of};

/// The folder of the runs, beside the store that their results are in.
pub fn folder(artifacts: &Path) -> PathBuf {
    artifacts.join("runs")
}

/// The folder of a run in progress. Other processes see the run as alive while this value exists.
#[derive(Debug)]
pub struct RunDir {
    /// The id of the run.
    pub id: String,
    /// The folder.
    pub path: PathBuf,
    /// Its number, one above the highest of all runs before it.
    pub number: u64,
    _alive: File,
}

impl RunDir {
    /// Makes the folder of a new run below `runs`.
    pub(crate) fn create(runs: &Path) -> anyhow::Result<Self> {
        fs::create_dir_all(runs).with_context(|| format!("cannot make {}", runs.display()))?;
        let mut salt = std::process::id();
        loop {
            let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
            let id = run_id(now.as_millis() as u64, (salt ^ now.subsec_nanos()) & 0xffff);
            let path = runs.join(&id);
            match Self::make(&path, &runs.join(format!("{FRESH_RUN}{id}"))) {
                Ok(alive) => {
                    let number = numbers::take(runs, &id)?;
                    return Ok(Self { id, path, number, _alive: alive });
                }
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => salt = salt.wrapping_add(1),
                Err(error) => return Err(error).with_context(|| format!("cannot make {}", path.display())),
            }
        }
    }

    /// Makes the folder of a run as `fresh` and locks its file `alive`. Then it renames the folder to `path`.
    fn make(path: &Path, fresh: &Path) -> io::Result<File> {
        if path.exists() {
            return Err(io::ErrorKind::AlreadyExists.into());
        }
        failpoint!("make run folder", fs::create_dir(fresh))?;
        let alive = failpoint!("mark alive", alive::mark(fresh))?;
        fs::create_dir(fresh.join("live"))?;
        failpoint!("name run folder", fs::rename(fresh, path))?;
        Ok(alive)
    }

    /// Lets `latest` point to this run.
    pub(crate) fn point_latest(&self) -> anyhow::Result<()> {
        point_latest(self.path.parent().unwrap_or(Path::new(".")), &self.id)
    }

    /// The path of a file as seen from the folder of the run.
    pub(crate) fn seen_from(&self, file: &Path) -> PathBuf {
        relative(file, &self.path)
    }

    /// Gives a file a readable name in the folder. The link is relative where it can be, so that the folder that holds
    /// both may be moved.
    pub(crate) fn link(&self, name: &str, file: &Path) -> anyhow::Result<()> {
        let path = self.path.join(name);
        let target = self.seen_from(file);
        match failpoint!("link result", symlink(&target, &path)) {
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {
                fs::remove_file(&path).and_then(|()| symlink(&target, &path))
            }
            other => other,
        }
        .with_context(|| format!("cannot link {}", path.display()))
    }
}

/// Lets `latest` point to a run. There is no moment without `latest`.
pub(super) fn point_latest(runs: &Path, id: &str) -> anyhow::Result<()> {
    let fresh = runs.join(format!("{FRESH_LINK}{id}"));
    failpoint!("mark latest", symlink(id, &fresh))
        .and_then(|()| failpoint!("rename latest", fs::rename(&fresh, runs.join("latest"))))
        .with_context(|| format!("cannot point {} to {id}", runs.join("latest").display()))
}

/// The path of a file as seen from a folder. Both paths must be absolute, or relative to the same folder.
fn relative(file: &Path, folder: &Path) -> PathBuf {
    let shared = file.components().zip(folder.components()).take_while(|(one, other)| one == other).count();
    if shared == 0 && file.is_absolute() != folder.is_absolute() {
        return file.to_owned();
    }
    let up = folder.components().skip(shared).map(|_| "..");
    up.map(PathBuf::from).chain(file.components().skip(shared).map(|part| PathBuf::from(part.as_os_str()))).collect()
}

/// The name of a node as the name of a file: `planar_online/represent@3` becomes `planar_online.represent@3`. The names
/// of stages and members hold no dots, so two nodes never share a file.
pub fn file_name(node: &str) -> String {
    node.replace(['/', '\0'], ".")
}

/// Whether the process of a run lives.
pub fn is_alive(run_dir: &Path) -> bool {
    alive::is_marked(run_dir)
}

/// Such as `20260802-143501-123-7f3a`: date, time and milliseconds in UTC, and a salt. Ids sort by time.
fn run_id(unix_millis: u64, salt: u32) -> String {
    let stamp: String = utc::text(unix_millis).chars().filter(|c| !matches!(c, '-' | ':' | 'Z')).collect();
    format!("{}-{:03}-{salt:04x}", stamp.replace('T', "-"), unix_millis % 1000)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_id_begins_with_the_time_and_has_its_shape_whatever_the_clock_says() {
        assert_eq!(run_id(1_785_681_301_123, 0x7f), "20260802-143501-123-007f");
        assert_eq!(run_id(u64::MAX, 0), "99991231-235959-615-0000");
        assert!(is_id(&run_id(0, 0xffff)) && is_id(&run_id(u64::MAX, 0)));
    }

    #[test]
    fn runs_that_start_at_once_have_different_numbers_and_none_is_used_again() {
        let folder = tempfile::tempdir().unwrap();
        let start = || RunDir::create(folder.path()).unwrap();
        let started: Vec<RunDir> = std::thread::scope(|scope| {
            let threads: Vec<_> = (0..8).map(|_| scope.spawn(|| (0..4).map(|_| start()).collect::<Vec<_>>())).collect();
            threads.into_iter().flat_map(|thread| thread.join().unwrap()).collect()
        });
        let mut numbers: Vec<u64> = started.iter().map(|run| run.number).collect();
        numbers.sort_unstable();
        assert_eq!(numbers, (1..=32).collect::<Vec<u64>>());
        let newest = started.iter().max_by_key(|run| run.number).unwrap();
        assert_eq!(list(folder.path()).unwrap()[0].id, newest.id);
        fs::remove_dir_all(&newest.path).unwrap();
        assert_eq!(start().number, 33);
    }

    #[test]
    fn a_damaged_list_of_numbers_leaves_the_numbers_that_runs_have_themselves() {
        let folder = tempfile::tempdir().unwrap();
        let run = RunDir::create(folder.path()).unwrap();
        let event = r#"{"event":"run_started","number":7,"pipeline":"p"}"#;
        fs::write(run.path.join("events.jsonl"), event).unwrap();
        let numbers = folder.path().join("numbers");
        for damaged in
            ["", "\u{0}\u{ff}", "x 20260802-143501-123-007f\n12", "99999999999999999999 20260802-143501-123-007f\n"]
        {
            fs::write(&numbers, damaged).unwrap();
            assert_eq!(list(folder.path()).unwrap()[0].number, Some(7), "{damaged:?}");
            let next = RunDir::create(folder.path()).unwrap();
            assert_eq!((next.number, list(folder.path()).unwrap()[0].number), (8, Some(8)), "{damaged:?}");
            fs::remove_dir_all(&next.path).unwrap();
        }
    }

    #[test]
    fn a_link_leads_from_one_folder_to_another() {
        let seen = |file: &str, folder: &str| relative(Path::new(file), Path::new(folder));
        assert_eq!(seen("a/objects/9f/1", "a/runs/7"), Path::new("../../objects/9f/1"));
        assert_eq!(seen("/b/objects/9f/1", "/a/runs/7"), Path::new("../../../b/objects/9f/1"));
        assert_eq!(seen("/b/objects/9f/1", "a/runs/7"), Path::new("/b/objects/9f/1"));
    }
}
