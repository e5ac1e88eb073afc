//! `carl-pipe replay`: runs a recorded run again in an empty store and compares every output and recording.

use std::path::PathBuf;

use serde_json::{Value, json};

use super::{
    Global,
    exit::{Error, Exit},
    out::{self, duration},
    run::exit_of,
    stop::Stop,
    working::WorkingArgs,
};
use crate::{
    run::{
        manifest::Manifest,
        replay::{Difference, Replayed, replay as replay_run},
    },
    stage::Kind,
    store::ResultStore,
};

/// The arguments of `replay`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The run: `latest`, `latest~1`, a tag, a pipeline (its newest run), a run id, or the beginning of an id.
    #[arg(value_name = "RUN", default_value = "latest")]
    run: String,
    #[command(flatten)]
    working: WorkingArgs,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// Replays a run.
pub(crate) fn replay(global: &Global, args: &Args, kinds: &'static [Kind]) -> Result<Exit, Error> {
    let store = global.store_to_run()?;
    let manifest = global.manifest(&args.run)?;
    let scratch = scratch_folder(&store, &manifest.run)?;
    let (options, progress) = args.working.start(Stop::listen()?, global, args.json, kinds);
    let find = |name: &str| kinds.iter().find(|kind| kind.name == name);
    let result = replay_run(&manifest, &store, &scratch, &options, &find, &*progress);
    progress.close();
    let _ = std::fs::remove_dir_all(&scratch);
    let replayed = result?;
    if args.json {
        out::json(&json_of(&manifest, &replayed));
    } else {
        print(&manifest, &replayed);
    }
    Ok(match exit_of(&replayed.report) {
        _ if !replayed.differences.is_empty() => Exit::ReplayDiffers,
        Exit::Ok if !replayed.unrecorded.is_empty() => Exit::Store,
        exit => exit,
    })
}

/// A new folder for the empty store, among the store's temporary files. The store removes it if the replay is killed.
fn scratch_folder(store: &dyn ResultStore, run: &str) -> Result<PathBuf, Error> {
    let folder = store.scratch_path(&format!("replay-{run}-{}", std::process::id()));
    std::fs::create_dir(&folder)
        .map_err(|error| Error::new(Exit::Store, format!("cannot make {}: {error}", folder.display())))?;
    Ok(folder)
}

fn json_of(manifest: &Manifest, replayed: &Replayed) -> Value {
    json!({
        "version": 1, "run": manifest.run, "state": replayed.report.state, "equal": replayed.equal,
        "differences": replayed.differences, "unrecorded": replayed.unrecorded, "wall_secs": replayed.report.wall_secs,
    })
}

fn print(manifest: &Manifest, replayed: &Replayed) {
    for Difference { node, what, recorded, replayed } in &replayed.differences {
        let now = replayed.map_or_else(|| "nothing".to_owned(), |digest| digest.short());
        out::line(&format!("{} {what} of {node}: was {}, now {now}", out::red("differs:"), recorded.short()));
    }
    for node in replayed.report.nodes() {
        if let Some(failure) = node.failure {
            out::line(&format!("{} {} failed: {}", out::red("error:"), node.record.about.name, failure.text()));
        }
    }
    for node in &replayed.unrecorded {
        out::line(&format!("{} the recording of {node} failed, so it was not compared", out::red("error:")));
    }
    let text = match &replayed.differences[..] {
        [] => format!("{} nodes of run {} have the same outputs and recordings", replayed.equal, manifest.run),
        [first, ..] => format!("run {} differs; the first node that differs is {}", manifest.run, first.node),
    };
    out::line(&out::bold(&format!("{text}, in {}", duration(replayed.report.wall_secs))));
}
