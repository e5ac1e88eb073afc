//! `carl-pipe run`: runs all nodes that are not up to date, shows progress, and prints the results.

use std::ffi::OsString;

use super::{
    Global,
    exit::{Error, Exit},
    file::{self, PipelineArgs},
    live::LiveView,
    out,
    output::refuse_inputs,
    progress::Progress,
    sink::Sink,
    status,
    stop::Stop,
    summary,
    working::WorkingArgs,
};
use crate::{
    pipeline::Graph,
    run::{
        events::{Event, Listener, RunState},
        execute::{self, Failure, Options, Order, Report},
        plan::{Force, plan},
        why::History,
    },
    stage::Kind,
};

/// The arguments of `run`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  carl-pipe run pipelines/smoke.toml
  carl-pipe run pipelines/planar_online.toml evaluate     this stage and all that it needs
  carl-pipe run pipelines/planar_online.toml --sweep seed=0..5 -k
  carl-pipe run pipelines/planar_online.toml --force=control@3

Ctrl-C stops the run at the next step. The same command then continues; finished nodes do not run again.")]
pub(crate) struct Args {
    #[command(flatten)]
    file: PipelineArgs,
    /// Stages or nodes to run, with all that they need; all stages if not given.
    #[arg(value_name = "TARGET")]
    targets: Vec<String>,
    /// Only show what would run and why.
    #[arg(short = 'n', long)]
    dry_run: bool,
    #[command(flatten)]
    working: WorkingArgs,
    /// After a failure, continue with the nodes that do not depend on it.
    #[arg(short, long)]
    keep_going: bool,
    /// Run nodes even if they are up to date: all nodes, or those of one stage or name; repeatable.
    #[arg(short, long, value_name = "STAGE", num_args = 0..=1, require_equals = true, default_missing_value = "")]
    force: Vec<String>,
    /// Also run nodes whose recording is gone; their outputs stay the same.
    #[arg(long, conflicts_with = "force")]
    repair: bool,
    /// What the run is for; `log` shows it.
    #[arg(long, value_name = "TEXT")]
    note: Option<String>,
    /// Watch the run live: spawn, connect[=URL], serve[=PORT] or save=FILE.
    #[arg(long, value_name = "SINK")]
    rerun: Option<Sink>,
    /// Print each event as a line of JSON; the last line is a summary.
    #[arg(long)]
    json: bool,
}

/// Runs a pipeline.
pub(crate) fn run(global: &Global, args: &Args, argv: &[OsString], kinds: &'static [Kind]) -> Result<Exit, Error> {
    let loaded = file::load(&args.file.pipeline, &args.file.changes, kinds, args.json)?;
    let graph = &loaded.graph;
    let wanted = file::pick(graph, &args.targets)?;
    let force = if args.repair { Force::Unrecorded } else { force(graph, &args.force)? };
    if args.dry_run {
        let plan = plan(graph, &wanted, &global.store_to_read()?, &force)?;
        status::show(graph, &plan, &mut History::new(&global.runs()), args.json, global);
        return Ok(Exit::Ok);
    }
    if let Some(output) = args.rerun.as_ref().and_then(Sink::file) {
        refuse_inputs(output, &loaded.files, &global.artifacts).map_err(|error| Error::usage(error.to_string()))?;
    }
    let store = global.store_to_run()?;
    let view = args.rerun.clone().map(|sink| LiveView::new(sink, global.runs())).transpose()?;
    let (options, progress) = args.working.start(Stop::listen()?, global, args.json, kinds);
    let options = Options { keep_going: args.keep_going, force, ..options };
    let argv: Vec<String> = argv.iter().map(|word| word.to_string_lossy().into_owned()).collect();
    let order = Order { graph, wanted, text: &loaded.text, argv: argv.clone(), note: args.note.clone() };
    let audience = Audience { progress, json: args.json, view };
    let report = execute::run(&store, &global.runs(), &order, &options, &audience)?;
    if let Some(text) = audience.view.as_ref().and_then(LiveView::close) {
        audience.progress.on_event(&Event::Warning { node: None, text });
    }
    audience.progress.close();
    let end = summary::End::of(&report, graph, &store, kinds);
    if args.json {
        out::json(&end.json());
    }
    end.print(global, args.json, &argv);
    let exit = exit_of(&report);
    // The process ends now. To free ten thousand nodes one by one would take a tenth of a run without changes.
    std::mem::forget((report, loaded));
    Ok(exit)
}

/// The exit code of a run that has ended.
pub(super) fn exit_of(report: &Report) -> Exit {
    match report.state {
        RunState::Finished => Exit::Ok,
        RunState::Interrupted | RunState::Running => Exit::Interrupted,
        RunState::Failed => {
            let mut failures = report.ends.iter().filter_map(|node| node.failure.as_ref());
            if failures.any(|failure| matches!(failure, Failure::System(_))) { Exit::Store } else { Exit::StageFailed }
        }
    }
}

/// The nodes that run even if they are up to date.
fn force(graph: &Graph, names: &[String]) -> Result<Force, Error> {
    if names.iter().any(String::is_empty) {
        return Ok(Force::All);
    }
    for name in names {
        if !(0..graph.nodes.len()).any(|id| graph.is_named(id, name)) {
            return Err(file::no_such_node(graph, name));
        }
    }
    Ok(if names.is_empty() { Force::None } else { Force::Named(names.iter().cloned().collect()) })
}

/// Passes the events of a run to the progress display, to standard output and to the live view.
struct Audience {
    progress: Box<dyn Progress>,
    json: bool,
    view: Option<LiveView>,
}

impl Listener for Audience {
    fn on_event(&self, event: &Event) {
        if self.json
            && let Ok(line) = serde_json::to_string(event)
        {
            out::json_text(&line);
        }
        self.progress.on_event(event);
        if let Some(warning) = self.view.as_ref().and_then(|view| view.on_event(event)) {
            self.progress.on_event(&Event::Warning { node: None, text: warning });
        }
    }
}
