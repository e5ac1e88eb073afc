//! `carl-pipe view`: opens runs and recordings in the Rerun viewer, or follows a run while it works.

use std::path::{Path, PathBuf};

use super::{
    Global,
    exit::{Error, Exit},
    out,
    stop::Stop,
};
use crate::{
    record::{self, Sink, Watcher},
    run::runs,
};

/// The arguments of `view`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  carl-pipe view latest                     a finished run
  carl-pipe view latest --follow            a run that still works
  carl-pipe view artifacts/runs/latest/represent@0.mcap
  carl-pipe view latest --rerun save=run.rrd")]
pub(crate) struct Args {
    /// Runs (`latest`, an id or its beginning), or files.
    #[arg(value_name = "RUN|FILE", default_value = "latest")]
    what: Vec<String>,
    /// Show a run as it works, until it ends.
    #[arg(long)]
    follow: bool,
    /// Where to show it: spawn, connect[=URL], serve[=PORT] or save=FILE.
    #[arg(long, value_name = "SINK", default_value = "spawn")]
    rerun: Sink,
}

/// Whoever looks at a run.
struct Onlooker {
    stop: Stop,
    run_dir: PathBuf,
}

impl Watcher for Onlooker {
    fn stop(&self) -> bool {
        self.stop.is_asked()
    }

    fn alive(&self) -> bool {
        runs::is_alive(&self.run_dir)
    }

    fn say(&self, text: &str) {
        out::note(text);
    }
}

/// Opens a view.
pub(crate) fn view(global: &Global, args: &Args) -> Result<Exit, Error> {
    let all = global.runs();
    let find = |what: &String| {
        if Path::new(what).exists() {
            return Ok(PathBuf::from(what));
        }
        runs::find(&all, what).map_err(|error| Error::usage(error.to_string()))
    };
    let paths: Vec<PathBuf> = args.what.iter().map(find).collect::<Result<_, _>>()?;
    let stop = Stop::listen()?;
    let onlooker = Onlooker { stop, run_dir: paths[0].clone() };
    match (args.follow, &paths[..]) {
        (true, [run_dir]) => record::follow(run_dir, &args.rerun, &onlooker)?,
        (true, _) => return Err(Error::usage("`--follow` takes one run")),
        (false, paths) => record::open(paths, &args.rerun, &onlooker)?,
    }
    Ok(Exit::Ok)
}
