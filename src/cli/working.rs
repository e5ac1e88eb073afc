//! What verbs share that run recorded nodes again.

use super::{
    Global,
    progress::{self, How, Progress},
    stop::Stop,
};
use crate::{run::execute::Options, stage::Kind};

/// How nodes run again.
#[derive(Debug, clap::Args)]
pub(crate) struct WorkingArgs {
    /// The largest number of nodes that run at once.
    #[arg(short, long, value_name = "N", env = "CARL_JOBS", hide_env_values = true)]
    jobs: Option<usize>,
    /// How to show progress: auto, bar, plain or none; see `carl-pipe run --help`.
    #[arg(long, value_name = "HOW", default_value = "auto", value_enum, hide_possible_values = true)]
    progress: How,
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
