//! Options of all verbs that run nodes.

use super::{
    Global,
    progress::{self, How, Progress},
    stop::Stop,
};
use crate::{run::execute::Options, stage::Kind};

/// How nodes run.
#[derive(Debug, clap::Args)]
pub(crate) struct WorkingArgs {
    /// The largest number of nodes that run at once, or auto; the nodes that run share all cores.
    #[arg(short, long, value_name = "N", env = "CARL_JOBS", hide_env_values = true, value_parser = jobs)]
    jobs: Option<usize>,
    /// How to show progress: auto, bar, plain or none; auto is bar on a terminal, none with `--json`, plain otherwise.
    #[arg(long, value_name = "HOW", default_value = "auto", value_enum, hide_possible_values = true)]
    progress: How,
}

fn jobs(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(count) if count > 0 => Ok(count),
        _ if text == "auto" => Ok(Options::default().jobs),
        _ => Err("must be a number above 0, or `auto`".to_owned()),
    }
}

impl WorkingArgs {
    /// The options of a run that `stop` ends, and what shows its progress.
    pub(crate) fn start(
        &self,
        stop: Stop,
        global: &Global,
        json: bool,
        kinds: &'static [Kind],
    ) -> (Options, Box<dyn Progress>) {
        let defaults = Options::default();
        let options = Options { jobs: self.jobs.unwrap_or(defaults.jobs), stop: stop.flag.clone(), ..defaults };
        (options, progress::new(self.progress.resolve(json, global.quiet), global, kinds, stop))
    }
}
