//! Looks at the program, the clock, the processor, the memory and the viewer.

#![allow(clippy::disallowed_methods, reason = "the clock is what is looked at; no result holds a time")]

use std::{
    env, fs,
    path::{Path, PathBuf},
    thread,
    time::{Duration, SystemTime},
};

use super::Finding;
use crate::{
    cli::{
        exit::Message,
        out,
        view_program::{self, VERSION},
    },
    num::simd::has_fused_vectors,
    stage::memory,
};

/// Clocks of machines that share a disk may differ by this much.
const TOLERANCE: Duration = Duration::from_secs(60);

/// With less free memory than this, large pipelines may be killed.
const LITTLE_MEMORY: u64 = 1_000_000_000;

/// Looks at everything; `runs` is the folder of the runs.
pub(super) fn look(runs: &Path, findings: &mut Vec<Finding>) {
    findings.push(clock(runs, SystemTime::now()));
    findings.push(program());
    findings.push(view());
    findings.push(viewer());
    findings.push(processor());
    findings.push(memory());
}

/// A clock that is behind gives new runs old names.
fn clock(runs: &Path, now: SystemTime) -> Finding {
    const HELP: &str = "set the clock; results do not depend on it, but runs are named after it";
    let written = |path: PathBuf| fs::metadata(path).and_then(|meta| meta.modified()).ok();
    let is_future = |time: SystemTime| time > now + TOLERANCE;
    if env::current_exe().ok().and_then(written).is_some_and(is_future) {
        return Finding::problem("clock", "it is before the time at which this program was built", HELP);
    }
    let folders = fs::read_dir(runs).into_iter().flatten().flatten().map(|item| item.path());
    let newest = folders.filter_map(|run_dir| written(run_dir.join("manifest.json"))).max();
    match newest {
        Some(newest) if is_future(newest) => {
            let ahead = newest.duration_since(now).unwrap_or_default().as_secs_f64();
            Finding::warning("clock", format!("the newest run lies {} in the future", out::duration(ahead)), HELP)
        }
        _ => Finding::ok("clock", "it is after the build and after every run"),
    }
}

fn program() -> Finding {
    let commit = option_env!("CARL_COMMIT").filter(|commit| !commit.is_empty());
    let commit = commit.map_or_else(|| "without a commit".to_owned(), |commit| format!("of commit {commit}"));
    Finding::ok("carl-pipe", format!("version {VERSION} {commit}"))
}

fn view() -> Finding {
    match view_program::find() {
        Ok(path) => Finding::ok("carl-view", format!("version {VERSION} in {}", path.display())),
        Err(error) => {
            let (Message::Clause(text) | Message::Rendered(text)) = error.text;
            Finding::warning("carl-view", text, error.help.unwrap_or_default())
        }
    }
}

fn viewer() -> Finding {
    let path = env::var_os("PATH").unwrap_or_default();
    let found = env::split_paths(&path).map(|folder| folder.join("rerun")).find(|file| view_program::is_program(file));
    match found {
        Some(path) => Finding::ok("viewer", path.display().to_string()),
        None => Finding::warning(
            "viewer",
            "there is no `rerun` on the PATH, so `--rerun spawn` cannot start one",
            "install it with `pip install rerun-sdk==0.36.3`",
        ),
    }
}

fn processor() -> Finding {
    let cores = thread::available_parallelism().map_or(1, usize::from);
    if has_fused_vectors() {
        let wide = if is_x86_feature_detected!("avx512f") { ", AVX-512" } else { "" };
        return Finding::ok("processor", format!("{cores} cores with AVX2, FMA{wide}"));
    }
    Finding::problem(
        "processor",
        "it has no AVX2 and FMA, so its results would differ from those of other machines",
        "run on an x86-64 processor made after 2015",
    )
}

fn memory() -> Finding {
    match memory::free() {
        Some(free) if free < LITTLE_MEMORY => Finding::warning(
            "memory",
            format!("{} are free", out::bytes(free)),
            "close other programs, or run fewer nodes at once with `-j 1`",
        ),
        Some(free) => Finding::ok("memory", format!("{} are free", out::bytes(free))),
        None => Finding::warning("memory", "unknown", "look at it with `free`"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::doctor::Level;

    #[test]
    fn a_clock_behind_the_newest_run_is_a_warning_and_behind_the_build_a_problem() {
        let runs = tempfile::tempdir().unwrap();
        let run_dir = runs.path().join("20260802-143501-123-007f");
        fs::create_dir(&run_dir).unwrap();
        fs::write(run_dir.join("manifest.json"), "").unwrap();
        let now = SystemTime::now();
        assert_eq!(clock(runs.path(), now).level, Level::Ok);
        let future = now + 10 * TOLERANCE;
        fs::File::options().write(true).open(run_dir.join("manifest.json")).unwrap().set_modified(future).unwrap();
        let found = clock(runs.path(), now);
        assert_eq!(
            (found.level, found.text.as_str()),
            (Level::Warning, "the newest run lies 10 min 00 s in the future")
        );
        assert_eq!(clock(runs.path(), SystemTime::UNIX_EPOCH).level, Level::Problem);
    }
}
