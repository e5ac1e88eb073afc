//! `carl-pipe replay`: runs a recorded run again in an empty store, and compares every output and recording.

use serde_json::json;

use super::{
    Global,
    exit::{Error, Exit},
    out::{self, duration},
    progress::{self, How, Progress},
    stop::Stop,
};
use crate::{
    run::{
        events::{Event, Listener, RunState},
        execute::Options,
        manifest::Manifest,
        replay::{Replayed, replay as replay_run},
        runs,
    },
    stage::Kind,
    store::ResultStore,
};

/// The arguments of `replay`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The run: `latest`, its id, or the beginning of its id.
    #[arg(value_name = "RUN", default_value = "latest")]
    run: String,
    /// How many nodes may run at once.
    #[arg(short, long, value_name = "N", env = "CARL_JOBS", hide_env_values = true)]
    jobs: Option<usize>,
    /// One JSON object.
    #[arg(long)]
    json: bool,
    /// How to show progress: auto, bar, plain or none.
    #[arg(long, value_name = "HOW", default_value = "auto", value_enum, hide_possible_values = true)]
    progress: How,
}

struct Quiet(Box<dyn Progress>);

impl Listener for Quiet {
    fn on_event(&self, event: &Event) {
        self.0.on_event(event);
    }
}

/// Replays a run.
pub(crate) fn replay(global: &Global, args: &Args, kinds: &'static [Kind]) -> Result<Exit, Error> {
    let store = global.store()?;
    let run_dir = runs::find(&global.runs(), &args.run).map_err(|error| Error::usage(error.to_string()))?;
    let manifest = Manifest::read(&run_dir)?;
    let scratch = tempfolder(&store, &manifest.run)?;
    let stop = Stop::listen()?;
    let defaults = Options::default();
    let options = Options { jobs: args.jobs.unwrap_or(defaults.jobs), stop: stop.flag.clone(), ..defaults };
    let listener = Quiet(progress::new(args.progress.resolve(args.json, global.quiet), global, stop));
    let find = |name: &str| kinds.iter().find(|kind| kind.name == name);
    let result = replay_run(&manifest, &store, &scratch, &options, &find, &listener);
    listener.0.close();
    let _ = std::fs::remove_dir_all(&scratch);
    let replayed = result?;
    show(&manifest, &replayed, args.json, global);
    Ok(match replayed.report.state {
        _ if !replayed.differences.is_empty() => Exit::ReplayDiffers,
        RunState::Finished => Exit::Ok,
        RunState::Failed => Exit::StageFailed,
        RunState::Interrupted | RunState::Running => Exit::Interrupted,
    })
}

/// A folder for the empty store, in the file system of the full one; what a killed replay leaves is swept with it.
fn tempfolder(store: &dyn ResultStore, run: &str) -> Result<std::path::PathBuf, Error> {
    let folder = store.scratch().join(format!("replay-{run}-{}", std::process::id()));
    std::fs::create_dir(&folder)
        .map_err(|error| Error::new(Exit::Store, format!("cannot make {}: {error}", folder.display())))?;
    Ok(folder)
}

fn show(manifest: &Manifest, replayed: &Replayed, json: bool, global: &Global) {
    let wall_secs = replayed.report.wall_secs;
    if json {
        let object = json!({
            "version": 1, "run": manifest.run, "state": replayed.report.state, "equal": replayed.equal,
            "differences": replayed.differences, "wall_secs": wall_secs,
        });
        out::line(&object.to_string());
        return;
    }
    let paint = global.color.on_stdout();
    for difference in &replayed.differences {
        let now = replayed_digest(difference.replayed);
        out::line(&format!(
            "{} {} of {}: was {}, now {now}",
            paint.red("differs:"),
            difference.what,
            difference.node,
            difference.recorded.short()
        ));
    }
    for node in replayed.report.nodes.iter().filter_map(|node| Some((node, node.failure.as_ref()?))) {
        out::line(&format!("{} {} failed: {}", paint.red("error:"), node.0.record.about.name, node.1.text()));
    }
    let text = match &replayed.differences[..] {
        [] => format!("{} nodes of run {} gave the same outputs and recordings", replayed.equal, manifest.run),
        [first, ..] => format!("run {} differs first at {}", manifest.run, first.node),
    };
    out::line(&paint.bold(&format!("{text}, in {}", duration(wall_secs))));
}

fn replayed_digest(digest: Option<crate::digest::Digest>) -> String {
    digest.map_or_else(|| "nothing".to_owned(), |digest| digest.short())
}
