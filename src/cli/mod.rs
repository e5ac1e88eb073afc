//! The command line: one file per verb, one shape for errors, documented exit codes.

mod compare;
mod dag;
mod exit;
mod file;
mod gc;
mod live;
mod log;
mod out;
mod plot;
mod progress;
mod replay;
mod run;
mod sink;
mod status;
mod stop;
mod summary;
mod table;
mod view;
mod view_program;
mod why;

use std::{ffi::OsString, path::PathBuf};

use clap::{CommandFactory as _, Parser, Subcommand};

pub use self::{
    sink::Sink,
    stop::Stop,
    view::{ViewArgs, ViewTarget},
    view_program::VERSION,
};
use crate::{run::runs, stage::Kind, store::LocalStore};
use exit::{CODES, Error, Exit, Message};
use out::Colour;

const EXAMPLES: &str = "Examples:
  carl-pipe run pipelines/planar_online.toml              run what is not up to date
  carl-pipe run pipelines/planar_online.toml -n           only say what would run, and why
  carl-pipe run pipelines/planar_online.toml --rerun spawn   watch it live
  carl-pipe run pipelines/planar_online.toml -S seed=1 -S represent.epochs=20
  carl-pipe why pipelines/planar_online.toml represent@3  what changed, old value and new
  carl-pipe view latest                                   look at the newest run
  carl-pipe plot latest -o figures                        its learning curve and latent maps
  carl-pipe run pipelines/table1.toml                     tasks times algorithms, and a table
  carl-pipe table latest --long                           every statistic of it
  carl-pipe compare 20261122-0748 latest                  what differs between two runs
  carl-pipe replay latest                                 run it again and compare every byte";

/// Declarative, cached, replayable pipelines for control-aware representation learning.
#[derive(Debug, Parser)]
#[command(name = "carl-pipe", version, about, after_help = format!("{EXAMPLES}\n\n{CODES}"), max_term_width = 100)]
struct Cli {
    #[command(flatten)]
    global: Global,
    #[command(subcommand)]
    verb: Verb,
}

/// What every verb takes.
#[derive(Debug, clap::Args)]
pub(crate) struct Global {
    /// Where results and runs are kept.
    #[arg(long, value_name = "DIR", env = "CARL_ARTIFACTS", hide_env_values = true, default_value = "artifacts")]
    #[arg(global = true, help_heading = "Everywhere")]
    artifacts: PathBuf,
    /// When to colour: auto, always or never; auto also heeds NO_COLOR.
    #[arg(long, value_name = "WHEN", default_value = "auto", value_enum, env = "CARL_COLOR", hide_env_values = true)]
    #[arg(global = true, help_heading = "Everywhere", hide_possible_values = true)]
    color: Colour,
    /// Say less: only results, warnings and errors.
    #[arg(short, long, global = true, help_heading = "Everywhere", conflicts_with = "verbose")]
    quiet: bool,
    /// Say more: every node on a line of its own.
    #[arg(short, long, global = true, help_heading = "Everywhere")]
    verbose: bool,
    /// Run as if started in this folder.
    #[arg(short = 'C', long = "directory", global = true, help_heading = "Everywhere", value_name = "DIR")]
    directory: Option<PathBuf>,
}

impl Global {
    fn store(&self) -> Result<LocalStore, Error> {
        Ok(LocalStore::open(&self.artifacts)?)
    }

    /// The folder of the runs.
    fn runs(&self) -> PathBuf {
        runs::folder(&self.artifacts)
    }
}

#[derive(Debug, Subcommand)]
enum Verb {
    /// Run what is not up to date.
    Run(run::Args),
    /// Say what is stale and why; runs nothing. Exit code 10 if something is.
    Status(status::Args),
    /// Say what changed for a node: old value and new.
    Why(why::Args),
    /// Draw the graph of a pipeline.
    Dag(dag::Args),
    /// Describe the kinds of stages, their inputs and parameters.
    Stages(dag::StagesArgs),
    /// List runs, newest first.
    Log(log::Args),
    /// Show what a run made, and where it lies.
    Show(log::ShowArgs),
    /// Open runs and recordings in the Rerun viewer.
    View(view::ViewArgs),
    /// Draw learning curves and latent maps of runs, as SVG.
    Plot(plot::Args),
    /// Show what runs reached, as a table of tasks and algorithms.
    Table(table::Args),
    /// Say what differs between two runs: parameters, metrics with their uncertainty, outputs.
    Compare(compare::Args),
    /// Run a recorded run again in an empty store, and compare every output and recording.
    Replay(replay::Args),
    /// Remove what no kept run names.
    Gc(gc::Args),
    /// Print a completion script for a shell.
    Completions {
        /// Which shell.
        shell: clap_complete::Shell,
    },
}

/// Runs the program with the given arguments and kinds of stages; returns its exit code.
pub fn main(argv: &[OsString], kinds: &'static [Kind]) -> u8 {
    exit_of(argv, kinds) as u8
}

fn exit_of(argv: &[OsString], kinds: &'static [Kind]) -> Exit {
    let cli = match Cli::try_parse_from(argv) {
        Ok(cli) => cli,
        Err(error) => {
            let _ = error.print();
            return if error.use_stderr() { Exit::Usage } else { Exit::Ok };
        }
    };
    let colour = cli.global.color;
    start(cli, argv, kinds).unwrap_or_else(|error| {
        report(&error, colour);
        error.exit
    })
}

fn start(cli: Cli, argv: &[OsString], kinds: &'static [Kind]) -> Result<Exit, Error> {
    let Cli { global, verb } = cli;
    if let Some(folder) = &global.directory {
        std::env::set_current_dir(folder)
            .map_err(|error| Error::usage(format!("cannot change to {}: {error}", folder.display())))?;
    }
    match verb {
        Verb::Run(args) => same_bits_everywhere().and_then(|()| run::run(&global, &args, argv, kinds)),
        Verb::Status(args) => status::status(&global, &args, kinds),
        Verb::Why(args) => why::why(&global, &args, kinds),
        Verb::Dag(args) => dag::dag(&args, kinds, global.color),
        Verb::Stages(args) => dag::stages(&args, kinds),
        Verb::Log(args) => log::log(&global, &args),
        Verb::Show(args) => log::show(&global, &args),
        Verb::View(args) => view::view(&global, &args),
        Verb::Plot(args) => plot::plot(&global, &args, kinds),
        Verb::Table(args) => table::table(&global, &args, kinds),
        Verb::Compare(args) => compare::compare(&global, &args, kinds),
        Verb::Replay(args) => same_bits_everywhere().and_then(|()| replay::replay(&global, &args, kinds)),
        Verb::Gc(args) => gc::gc(&global, &args),
        Verb::Completions { shell } => {
            let mut script = Vec::new();
            clap_complete::generate(shell, &mut Cli::command(), "carl-pipe", &mut script);
            out::print(&String::from_utf8_lossy(&script));
            Ok(Exit::Ok)
        }
    }
}

/// Refuses processors on which faer's products would round differently: without fused multiply-adds.
fn same_bits_everywhere() -> Result<(), Error> {
    if crate::num::simd::has_fused_vectors() {
        return Ok(());
    }
    let text = "this processor has no AVX2 and FMA, so its results would differ from those of other machines";
    Err(Error::new(Exit::Store, text).help("run it on an x86-64 processor made after 2015"))
}

/// Writes an error to standard error: a clause, then help that names the next step.
fn report(error: &Error, colour: Colour) {
    let paint = colour.on_stderr();
    match &error.text {
        Message::Clause(text) => out::note(&format!("{} {}", paint.red("error:"), out::tidy(text))),
        Message::Rendered(text) => out::note(text.trim_end()),
    }
    if let Some(help) = &error.help {
        out::note(&format!("  = {} {help}", paint.bold("help:")));
    }
}
