//! `carl-pipe doctor`: looks at the store, the file system and the machine, and says what to do about what is wrong.

mod file_system;
mod machine;
mod store;

use serde_json::json;

use super::{
    Global,
    exit::{Error, Exit},
    out,
};
use crate::store::ResultStore as _;

/// The arguments of `doctor`.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Each line is `ok`, a `warning` (something works less well) or a `problem` (runs would fail or lose \
results). Exit code 4 if there is a problem. It writes only to a temporary folder in the store, which it removes.

Examples:
  carl-pipe doctor
  carl-pipe doctor --artifacts /mnt/results       before a long run on another disk"
)]
pub(crate) struct Args {
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// How good or bad a finding is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, serde::Serialize)]
#[serde(rename_all = "snake_case")]
enum Level {
    Ok,
    Warning,
    Problem,
}

/// What was found about one thing.
#[derive(Debug, serde::Serialize)]
struct Finding {
    about: &'static str,
    level: Level,
    text: String,
    /// What to do, for warnings and problems.
    help: Option<String>,
}

impl Finding {
    fn ok(about: &'static str, text: impl Into<String>) -> Self {
        Self { about, level: Level::Ok, text: text.into(), help: None }
    }

    fn warning(about: &'static str, text: impl Into<String>, help: impl Into<String>) -> Self {
        Self { about, level: Level::Warning, text: text.into(), help: Some(help.into()) }
    }

    fn problem(about: &'static str, text: impl Into<String>, help: impl Into<String>) -> Self {
        Self { about, level: Level::Problem, text: text.into(), help: Some(help.into()) }
    }

    fn rows(&self) -> Vec<Vec<String>> {
        let level = match self.level {
            Level::Ok => out::green("ok"),
            Level::Warning => out::yellow("warning"),
            Level::Problem => out::red("problem"),
        };
        let help = self.help.iter().map(|help| vec![String::new(), String::new(), format!("= {help}")]);
        std::iter::once(vec![level, self.about.to_owned(), self.text.clone()]).chain(help).collect()
    }
}

/// Looks at everything that a run depends on.
pub(crate) fn doctor(global: &Global, args: &Args) -> Result<Exit, Error> {
    let mut findings = Vec::new();
    match store::look(&global.artifacts, &mut findings) {
        // The open store keeps others from sweeping the folder away.
        Some(open) => {
            let folder = open.scratch_path(&format!("doctor-{}", std::process::id()));
            file_system::look(&folder, &mut findings);
        }
        None => findings.push(Finding::warning(
            "file system",
            "not checked: there is no store to write to",
            "`carl-pipe run PIPELINE` makes the store; then ask again",
        )),
    }
    machine::look(&global.runs(), &mut findings);
    let worst = findings.iter().map(|finding| finding.level).max().unwrap_or(Level::Ok);
    if args.json {
        out::json(&json!({"version": 1, "worst": worst, "findings": findings}));
    } else {
        out::print(&out::table(&findings.iter().flat_map(Finding::rows).collect::<Vec<_>>()));
    }
    Ok(if worst == Level::Problem { Exit::Store } else { Exit::Ok })
}
