//! The command line: one file for each verb, one shape for all errors, documented exit codes.

mod bug;
mod compare;
mod dag;
mod disk;
mod doctor;
mod du;
mod exit;
mod export;
mod export_policy;
mod file;
mod finished_node;
mod gc;
mod init;
mod live;
mod log;
mod mark;
mod out;
mod output;
mod plot;
mod progress;
mod replay;
mod run;
mod show;
mod sink;
mod status;
mod stop;
mod summary;
mod table;
mod verify;
mod view;
mod view_program;
mod why;
mod working;

use std::{ffi::OsString, panic::catch_unwind, path::PathBuf};

use clap::{CommandFactory as _, Parser, Subcommand};

pub use self::{
    sink::Sink,
    stop::Stop,
    view::{ViewArgs, ViewTarget},
    view_program::VERSION,
};
use crate::{
    diag::visible,
    pipeline,
    run::{manifest::Manifest, runs},
    stage::Kind,
    store::LocalStore,
};
use exit::{CODES, Error, Exit, Message};

const EXAMPLES: &str = "Examples:
  carl-pipe run pipelines/planar_online.toml              run all nodes that are not up to date
  carl-pipe run pipelines/planar_online.toml -n           show what would run and why
  carl-pipe run pipelines/planar_online.toml --rerun spawn   watch the run live
  carl-pipe run pipelines/planar_online.toml -S seed=1 -S represent.epochs=20
  carl-pipe why pipelines/planar_online.toml represent@3  show what changed for a node
  carl-pipe view latest                                   open the newest run in the viewer
  carl-pipe plot latest -o figures                        draw its learning curve and latent maps
  carl-pipe run pipelines/table1.toml                     run several tasks and algorithms
  carl-pipe table latest --long                           print every statistic of their results
  carl-pipe compare 20261122-0748 latest                  show how two runs differ
  carl-pipe replay latest                                 run it again and compare every byte
  carl-pipe tag latest best                               give it a name that finds it
  carl-pipe gc --dry-run                                  show which old results would go";

/// Declarative, cached, replayable pipelines for control-aware representation learning.
#[derive(Debug, Parser)]
#[command(name = "carl-pipe", version, about, after_help = format!("{EXAMPLES}\n\n{CODES}"), max_term_width = 100)]
struct Cli {
    #[command(flatten)]
    global: Global,
    #[command(subcommand)]
    verb: Verb,
}

/// The options that every verb takes.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Global options")]
pub(crate) struct Global {
    /// The folder of results and runs.
    #[arg(long, value_name = "DIR", env = "CARL_ARTIFACTS", hide_env_values = true, default_value = "artifacts")]
    #[arg(global = true)]
    artifacts: PathBuf,
    /// When to use colours: auto, always or never; auto uses them on a terminal unless NO_COLOR is set.
    #[arg(long, value_name = "WHEN", default_value = "auto", value_enum, env = "CARL_COLOR", hide_env_values = true)]
    #[arg(global = true, hide_possible_values = true)]
    color: clap::ColorChoice,
    /// Print only results, warnings and errors.
    #[arg(short, long, global = true, conflicts_with = "verbose")]
    quiet: bool,
    /// Print more, such as a line for every node.
    #[arg(short, long, global = true)]
    verbose: bool,
    /// Run as if started in this folder.
    #[arg(short = 'C', long = "directory", global = true, value_name = "DIR")]
    directory: Option<PathBuf>,
}

impl Global {
    /// The store, for a verb that runs something. It is made where there is none.
    fn store_to_run(&self) -> Result<LocalStore, Error> {
        Ok(LocalStore::open(&self.artifacts)?)
    }

    /// The store, for a verb that only reads. Nothing in its folder changes.
    fn store_to_read(&self) -> Result<LocalStore, Error> {
        Ok(LocalStore::open_to_read(&self.artifacts)?)
    }

    /// The folder of the runs.
    fn runs(&self) -> PathBuf {
        runs::folder(&self.artifacts)
    }

    /// The manifest of the run that a user names; see [`runs::find`].
    fn manifest(&self, run: &str) -> Result<Manifest, Error> {
        Ok(Manifest::read(&runs::find(&self.runs(), run)?)?)
    }
}

#[derive(Debug, Subcommand)]
enum Verb {
    /// Run all nodes that are not up to date.
    Run(run::Args),
    /// Show which nodes are stale and why, without running them; exit code 10 if any node is stale.
    Status(status::Args),
    /// Show what changed for a node: old values and new values.
    Why(why::Args),
    /// Print the graph of a pipeline.
    Dag(dag::Args),
    /// Describe the kinds of stages with their inputs and parameters.
    Stages(dag::StagesArgs),
    /// Print the JSON schema of pipeline files, for editors.
    Schema,
    /// Write a commented pipeline to start from.
    Init(init::Args),
    /// List runs, newest first.
    Log(log::Args),
    /// Show the results of a run and the paths of their files.
    Show(show::Args),
    /// Open runs and recordings in the Rerun viewer.
    View(view::ViewArgs),
    /// Draw learning curves and latent maps of runs as SVG files.
    Plot(plot::Args),
    /// Print the results of runs as a table of tasks and algorithms.
    Table(table::Args),
    /// Compare two runs: parameters, metrics with their uncertainty, outputs.
    Compare(compare::Args),
    /// Write the arrays of a node's output as a file of NumPy.
    Export(export::Args),
    /// Write a trained policy as an ONNX file, from pictures to actions.
    ExportPolicy(export_policy::Args),
    /// Run a recorded run again in an empty store and compare every output and recording.
    Replay(replay::Args),
    /// Read all results and recordings and name what is damaged; `--repair` makes it again.
    Verify(verify::Args),
    /// Look at the store, the file system and the machine, and say what to do about what is wrong.
    Doctor(doctor::Args),
    /// Protect a run from `gc`.
    Pin(mark::PinArgs),
    /// Let `gc` remove a run again.
    Unpin(mark::UnpinArgs),
    /// Name a run, to find it by the name and to keep it.
    Tag(mark::TagArgs),
    /// Show what takes the room, by pipeline and run.
    Du(du::Args),
    /// Delete old runs without pin or tag, and results that no kept run uses.
    Gc(gc::Args),
    /// Print a completion script for a shell.
    Completions {
        /// The shell.
        shell: clap_complete::Shell,
    },
}

/// Runs the program with these arguments and these kinds of stages. Returns its exit code.
pub fn main(argv: &[OsString], kinds: &'static [Kind]) -> u8 {
    bug::report_in_one_line();
    code_of(catch_unwind(|| exit_of(argv, kinds)).unwrap_or(Exit::Store))
}

/// The arguments of another program, such as `carl-view`, parsed like those of `carl-pipe`.
///
/// # Errors
/// The exit code with which the program should end: help was asked for and written, or a mistake was reported.
pub fn parse<A: Parser>(argv: impl IntoIterator<Item = OsString>) -> Result<A, u8> {
    parsed(argv).map_err(code_of)
}

fn parsed<A: Parser>(argv: impl IntoIterator<Item = OsString>) -> Result<A, Exit> {
    A::try_parse_from(argv).map_err(|error| {
        out::of_clap(&error);
        if error.use_stderr() { Exit::Usage } else { Exit::Ok }
    })
}

/// The exit code of the process. Output that was lost is an error.
fn code_of(exit: Exit) -> u8 {
    let Some(why) = out::lost() else { return exit as u8 };
    report(&Error::new(Exit::Store, format!("cannot write to standard output: {why}")));
    match exit {
        Exit::Ok | Exit::Stale => Exit::Store as u8,
        failure => failure as u8,
    }
}

fn exit_of(argv: &[OsString], kinds: &'static [Kind]) -> Exit {
    let cli: Cli = match parsed(argv.iter().cloned()) {
        Ok(cli) => cli,
        Err(exit) => return exit,
    };
    out::set_colour(cli.global.color);
    start(cli, argv, kinds).unwrap_or_else(|error| {
        report(&error);
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
        Verb::Dag(args) => dag::dag(&args, kinds),
        Verb::Stages(args) => dag::stages(&args, kinds),
        Verb::Schema => {
            out::json(&pipeline::schema(kinds));
            Ok(Exit::Ok)
        }
        Verb::Init(args) => init::init(&args),
        Verb::Log(args) => log::log(&global, &args, kinds),
        Verb::Show(args) => show::show(&global, &args),
        Verb::View(args) => view::view(&global, &args),
        Verb::Plot(args) => plot::plot(&global, &args, kinds),
        Verb::Table(args) => table::table(&global, &args, kinds),
        Verb::Compare(args) => compare::compare(&global, &args, kinds),
        Verb::Export(args) => export::export(&global, &args),
        Verb::ExportPolicy(args) => export_policy::export_policy(&global, &args, kinds),
        Verb::Replay(args) => same_bits_everywhere().and_then(|()| replay::replay(&global, &args, kinds)),
        Verb::Verify(args) => same_bits_everywhere().and_then(|()| verify::verify_verb(&global, &args, kinds)),
        Verb::Doctor(args) => doctor::doctor(&global, &args),
        Verb::Pin(args) => mark::pin(&global, &args),
        Verb::Unpin(args) => mark::unpin(&global, &args),
        Verb::Tag(args) => mark::tag(&global, &args),
        Verb::Du(args) => du::du(&global, &args),
        Verb::Gc(args) => gc::gc(&global, &args),
        Verb::Completions { shell } => {
            let mut script = Vec::new();
            clap_complete::generate(shell, &mut Cli::command(), "carl-pipe", &mut script);
            out::script(&String::from_utf8_lossy(&script));
            Ok(Exit::Ok)
        }
    }
}

/// Refuses a processor without fused multiply-adds: faer's matrix products would round differently there.
fn same_bits_everywhere() -> Result<(), Error> {
    if crate::num::simd::has_fused_vectors() {
        return Ok(());
    }
    let text = "this processor has no AVX2 and FMA, so its results would differ from those of other machines";
    Err(Error::new(Exit::Store, text).help("run it on an x86-64 processor made after 2015"))
}

/// Writes an error to standard error, then the next step for the user.
fn report(error: &Error) {
    match &error.text {
        Message::Clause(text) => out::note(&format!("{} {}", out::red("error:"), visible(&out::tidy(text)))),
        Message::Rendered(text) => out::note_coloured(text.trim_end()),
    }
    if let Some(help) = &error.help {
        out::note(&format!("  = {} {}", out::bold("help:"), visible(help)));
    }
}
