//! `carl-pipe view`: opens runs and recordings in the Rerun viewer, or follows a run while it works.
//!
//! `carl-pipe` checks the arguments and then becomes `carl-view`, which takes the same arguments.

use std::{
    os::unix::process::CommandExt as _,
    path::{Path, PathBuf},
    process::Command,
};

use anyhow::bail;

use super::{
    Global,
    exit::{Error, Exit},
    output::{files_of_run, refuse_inputs},
    sink::Sink,
    view_program,
};
use crate::{record, run::runs};

/// The arguments of `carl-pipe view`, and of `carl-view`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  carl-pipe view latest                     a finished run
  carl-pipe view latest --follow            a run that still works
  carl-pipe view artifacts/runs/latest/represent@0.mcap
  carl-pipe view latest --rerun save=run.rrd")]
pub struct ViewArgs {
    /// Runs (`latest`, `latest~1`, a tag, a pipeline, an id or its beginning), or files.
    #[arg(value_name = "RUN|FILE", default_value = "latest")]
    what: Vec<String>,
    /// Show a run as it works, until it ends.
    #[arg(long)]
    follow: bool,
    /// Where to show it: spawn, connect[=URL], serve[=PORT] or save=FILE.
    #[arg(long, value_name = "SINK", default_value = "spawn")]
    pub rerun: Sink,
}

/// What to show.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ViewTarget {
    /// The folder of a run, to be followed until the run ends.
    Follow(PathBuf),
    /// Folders of runs and recordings, as they are now.
    Open(Vec<PathBuf>),
}

impl ViewArgs {
    /// The files and folders to show. Runs are found in the store `artifacts`.
    ///
    /// # Errors
    /// If there is no such run or file, none of the files is a recording, more than one run is to be followed, or the
    /// sink is a file that would be read.
    pub fn target(&self, artifacts: &Path) -> anyhow::Result<ViewTarget> {
        let runs = runs::folder(artifacts);
        let find = |what: &String| {
            if Path::new(what).exists() { Ok(PathBuf::from(what)) } else { runs::find(&runs, what) }
        };
        let mut paths: Vec<PathBuf> = self.what.iter().map(find).collect::<Result<_, _>>()?;
        if let Some(output) = self.rerun.file() {
            let inputs: Vec<PathBuf> = paths.iter().flat_map(|path| inputs(path)).collect();
            refuse_inputs(output, &inputs, artifacts)?;
        }
        match (self.follow, paths.len()) {
            (false, _) => {
                refuse_unfit(&paths)?;
                Ok(ViewTarget::Open(paths))
            }
            (true, 1) if paths[0].is_dir() => Ok(ViewTarget::Follow(paths.remove(0))),
            (true, _) => bail!("`--follow` takes one run"),
        }
    }
}

/// The files that a path stands for.
fn inputs(path: &Path) -> Vec<PathBuf> {
    if path.is_dir() { files_of_run(path) } else { vec![path.to_owned()] }
}

/// Refuses files of which none can be shown. Where some can, the view names the others.
fn refuse_unfit(paths: &[PathBuf]) -> anyhow::Result<()> {
    let mut reasons = Vec::new();
    for path in paths {
        match if path.is_dir() { Ok(()) } else { record::check(path) } {
            Ok(()) => return Ok(()),
            Err(why) => reasons.push(format!("cannot show {}: {why}", path.display())),
        }
    }
    bail!(reasons.join("; "))
}

/// The command that shows `target` with `carl-view`.
pub(crate) fn command(program: &Path, target: &ViewTarget, sink: &Sink) -> Command {
    let mut command = Command::new(program);
    command.args(["--rerun", &sink.to_string()]);
    match target {
        ViewTarget::Follow(run_dir) => command.arg("--follow").arg("--").arg(run_dir),
        ViewTarget::Open(paths) => command.arg("--").args(paths),
    };
    command
}

/// Becomes `carl-view`, which then has the terminal, the signals and the exit code of this process.
pub(crate) fn view(global: &Global, args: &ViewArgs) -> Result<Exit, Error> {
    let target = args.target(&global.artifacts).map_err(|error| match error.downcast::<runs::FindError>() {
        Ok(error) => error.into(),
        Err(error) => Error::usage(error.to_string()),
    })?;
    let program = view_program::find()?;
    let error = command(&program, &target, &args.rerun).exec();
    Err(Error::new(Exit::Store, format!("cannot start {}: {error}", program.display())))
}
