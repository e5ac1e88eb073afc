//! Shows carl-pipe's runs and recordings in the Rerun viewer. `carl-pipe view` and `carl-pipe run --rerun` start it.

use std::{
    io::Write as _,
    path::{Path, PathBuf},
    process::ExitCode,
};

use carl_pipe::{
    cli::{self, Stop, ViewArgs, ViewTarget},
    diag::visible,
    run::runs,
};
use carl_view::{RerunViewer, ViewHost, Viewer as _, follow, open};

/// The exit code of carl-pipe for an error of the store or the system.
const SYSTEM_ERROR: u8 = 4;

/// Shows runs and recordings of carl-pipe in the Rerun viewer.
#[derive(Debug, clap::Parser)]
#[command(name = "carl-view", version = carl_pipe::cli::VERSION, max_term_width = 100)]
struct Args {
    #[command(flatten)]
    view: ViewArgs,
    /// The folder of results and runs.
    #[arg(long, value_name = "DIR", env = "CARL_ARTIFACTS", hide_env_values = true, default_value = "artifacts")]
    artifacts: PathBuf,
}

/// A view in a terminal, or in the log file of a run.
struct Terminal<'a> {
    stop: Stop,
    run_dir: Option<&'a Path>,
}

impl ViewHost for Terminal<'_> {
    fn should_stop(&self) -> bool {
        self.stop.is_asked()
    }

    fn run_is_alive(&self) -> bool {
        self.run_dir.is_some_and(runs::is_alive)
    }

    fn note(&self, text: &str) {
        say(text);
    }
}

/// Writes a line to standard error, which may be closed.
fn say(text: &str) {
    let _ = writeln!(std::io::stderr(), "{}", visible(text));
}

fn main() -> ExitCode {
    let args: Args = match cli::parse(std::env::args_os()) {
        Ok(args) => args,
        Err(code) => return ExitCode::from(code),
    };
    match show(&args) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            say(&format!("error: {error:#}"));
            ExitCode::from(SYSTEM_ERROR)
        }
    }
}

fn show(args: &Args) -> anyhow::Result<()> {
    let target = args.view.target(&args.artifacts)?;
    let run_dir = match &target {
        ViewTarget::Follow(run_dir) => Some(run_dir.as_path()),
        ViewTarget::Open(_) => None,
    };
    let host = Terminal { stop: Stop::listen()?, run_dir };
    let mut viewer = RerunViewer::open(&args.view.rerun, &host)?;
    match &target {
        ViewTarget::Follow(run_dir) => follow(run_dir, &mut viewer, &host)?,
        ViewTarget::Open(paths) => open(paths, &mut viewer, &host)?,
    }
    viewer.close(&host)
}
