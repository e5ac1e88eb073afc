//! The folders of runs: ids that sort by time, lookup by prefix, `latest`, and links to what a run names.

#![allow(
    clippy::disallowed_methods,
    reason = "wall times are kept beside a run and name its folder; no key and no result holds one"
)]

use std::{
    fs::{self, File},
    io,
    os::unix::fs::symlink,
    path::{Path, PathBuf},
    time::{SystemTime, UNIX_EPOCH},
};

use anyhow::{Context as _, bail};

use super::manifest::Manifest;
use crate::store::{is_held, object_below_root};
use crate::{digest::Digest, store};

/// The folder of a run that is being made; others see it as alive while this value lives.
#[derive(Debug)]
pub struct RunDir {
    /// The run's id.
    pub id: String,
    /// The folder.
    pub path: PathBuf,
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
            match fs::create_dir(&path) {
                Ok(()) => {
                    let alive = store::mark_alive(&path.join("alive"))?;
                    let live = path.join("live");
                    fs::create_dir(&live).with_context(|| format!("cannot make {}", live.display()))?;
                    return Ok(Self { id, path, _alive: alive });
                }
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => salt = salt.wrapping_add(1),
                Err(error) => return Err(error).with_context(|| format!("cannot make {}", path.display())),
            }
        }
    }

    /// Lets `latest` point to this run.
    pub(crate) fn point_latest(&self) -> anyhow::Result<()> {
        let runs = self.path.parent().unwrap_or(Path::new("."));
        let fresh = runs.join(format!(".latest-{}", self.id));
        symlink(&self.id, &fresh)
            .and_then(|()| fs::rename(&fresh, runs.join("latest")))
            .with_context(|| format!("cannot point {} to {}", runs.join("latest").display(), self.id))
    }

    /// Gives an object a readable name in the folder; the link is relative, so that a store may be moved.
    pub(crate) fn link(&self, name: &str, object: Digest) -> anyhow::Result<()> {
        let path = self.path.join(name);
        let up = if name.contains('/') { "../../.." } else { "../.." };
        let target = Path::new(up).join(object_below_root(object));
        match symlink(&target, &path) {
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {
                fs::remove_file(&path).and_then(|()| symlink(&target, &path))
            }
            other => other,
        }
        .with_context(|| format!("cannot link {}", path.display()))
    }
}

/// A node's name as a file name: `planar_online/represent@3` lies in `planar_online.represent@3.mcap`. No name of a stage
/// or of a member holds a dot, so two nodes never share a file.
pub fn file_name(node: &str) -> String {
    node.replace(['/', '\0'], ".")
}

/// The ids of all runs, newest first.
///
/// # Errors
/// What the system says.
pub fn list(runs: &Path) -> anyhow::Result<Vec<String>> {
    let items = match fs::read_dir(runs) {
        Ok(items) => items,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err(error).with_context(|| format!("cannot read {}", runs.display())),
    };
    let mut ids = Vec::new();
    for item in items {
        let item = item.with_context(|| format!("cannot read {}", runs.display()))?;
        let is_folder = item.file_type().is_ok_and(|kind| kind.is_dir());
        ids.extend(item.file_name().into_string().ok().filter(|_| is_folder));
    }
    ids.sort_unstable_by(|a, b| b.cmp(a));
    Ok(ids)
}

/// Finds a run by `latest`, its id, or the beginning of its id if no other run begins so.
///
/// # Errors
/// None or several such runs.
pub fn find(runs: &Path, wanted: &str) -> anyhow::Result<PathBuf> {
    let ids = list(runs)?;
    if wanted == "latest" {
        let pointed = fs::read_link(runs.join("latest")).map(|id| runs.join(id)).ok().filter(|path| path.exists());
        return match (pointed, ids.first()) {
            (Some(path), _) => Ok(path),
            (None, Some(newest)) => Ok(runs.join(newest)),
            _ => bail!("there are no runs in {} yet; start one with `carl-pipe run PIPELINE`", runs.display()),
        };
    }
    let found: Vec<_> = ids.iter().filter(|id| id.starts_with(wanted)).collect();
    match found[..] {
        [id] => Ok(runs.join(id)),
        [] => bail!("no run begins with `{wanted}`; `carl-pipe log` lists them"),
        [..] if ids.iter().any(|id| id == wanted) => Ok(runs.join(wanted)),
        [first, .., last] => bail!("{} runs begin with `{wanted}`, from {last} to {first}", found.len()),
    }
}

/// True while the process of a run lives.
pub fn is_alive(run_dir: &Path) -> bool {
    is_held(&run_dir.join("alive"))
}

/// The manifests of all runs, newest first; unreadable ones are left out.
pub fn manifests(runs: &Path) -> impl Iterator<Item = Manifest> {
    let runs = runs.to_owned();
    list(&runs).unwrap_or_default().into_iter().filter_map(move |id| Manifest::read(&runs.join(id)).ok())
}

/// `20260802-143501-123-7f3a`: date, time and milliseconds in UTC, and a salt.
fn run_id(unix_millis: u64, salt: u32) -> String {
    let stamp: String = utc(unix_millis).chars().filter(|c| !matches!(c, '-' | ':' | 'Z')).collect();
    format!("{}-{:03}-{salt:04x}", stamp.replace('T', "-"), unix_millis % 1000)
}

/// `2026-08-02T14:35:01Z`.
pub fn utc(unix_millis: u64) -> String {
    let secs = unix_millis / 1000;
    let (days, of_day) = (secs / 86_400, secs % 86_400);
    // Days to year, month and day in the Gregorian calendar, from March of year 0 (Howard Hinnant).
    let shifted = days + 719_468;
    let (era, of_era) = (shifted / 146_097, shifted % 146_097);
    let year_of_era = (of_era - of_era / 1_460 + of_era / 36_524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let shifted_month = (5 * of_year + 2) / 153;
    let day = of_year - (153 * shifted_month + 2) / 5 + 1;
    let month = if shifted_month < 10 { shifted_month + 3 } else { shifted_month - 9 };
    let year = year_of_era + era * 400 + u64::from(month <= 2);
    let (hour, minute, second) = (of_day / 3_600, of_day / 60 % 60, of_day % 60);
    format!("{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}Z")
}

/// The time now, for manifests.
pub(crate) fn utc_now() -> String {
    utc(SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_millis() as u64))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_written_in_utc() {
        assert_eq!(utc(0), "1970-01-01T00:00:00Z");
        assert_eq!(utc(951_827_696_000), "2000-02-29T12:34:56Z");
        assert_eq!(run_id(1_785_681_301_123, 0x7f), "20260802-143501-123-007f");
    }
}
