//! `carl-pipe du`: shows what takes the room, by pipeline and run.

use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;
use serde_json::{Value, json};

use super::{
    Global,
    exit::{Error, Exit},
    out,
};
use crate::{
    digest::Digest,
    report::groups::grouped,
    run::holdings::{Holding, Holdings, bytes_below},
};

/// The arguments of `du`.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "`own` is what only this run, or only runs of this pipeline, need: so much becomes free if they \
go. `shared` is what others need too; in the total it counts once.

Examples:
  carl-pipe du
  carl-pipe du -v                                         with a row for each run
  carl-pipe du --json"
)]
pub(crate) struct Args {
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// How much room something takes, in bytes.
#[derive(Debug, Clone, Copy, Default, Serialize)]
struct Room {
    /// What nothing else needs, and folders of runs.
    own: u64,
    /// What others need too.
    shared: u64,
}

/// A pipeline with its runs.
struct Pipeline<'a> {
    name: String,
    room: Room,
    runs: Vec<(&'a Holding, Room)>,
}

impl Pipeline<'_> {
    fn json(&self) -> Value {
        let run = |(run, room): &(&Holding, Room)| {
            json!({
                "run": run.id, "state": run.state, "pinned": run.is_pinned, "results": run.results.len(),
                "own_bytes": room.own, "shared_bytes": room.shared,
            })
        };
        let runs: Vec<Value> = self.runs.iter().map(run).collect();
        json!({"pipeline": self.name, "own_bytes": self.room.own, "shared_bytes": self.room.shared, "runs": runs})
    }
}

/// Shows what takes the room.
pub(crate) fn du(global: &Global, args: &Args) -> Result<Exit, Error> {
    let store = global.store_to_read()?;
    let holdings = Holdings::read(&store, &global.runs())?;
    let pipelines = pipelines(&holdings);
    let total = Total::of(global, &holdings);
    if args.json {
        let pipelines: Vec<Value> = pipelines.iter().map(Pipeline::json).collect();
        out::json(&json!({"version": 1, "total": total, "pipelines": pipelines}));
        return Ok(Exit::Ok);
    }
    let mut rows = vec![["pipeline", "runs", "own", "shared"].map(out::bold).to_vec()];
    for Pipeline { name, room, runs } in &pipelines {
        rows.push(row(name, &runs.len().to_string(), *room));
        for (run, room) in runs.iter().filter(|_| global.verbose) {
            rows.push(row(&format!("  {}", run.id), run.state.word(), *room));
        }
    }
    out::print(&out::table(&rows));
    total.print();
    Ok(Exit::Ok)
}

fn pipelines(holdings: &Holdings) -> Vec<Pipeline<'_>> {
    let runs = holdings.runs.iter().zip(rooms(holdings, holdings.runs.iter().map(|run| vec![run])));
    let groups = grouped(runs, |(run, _)| run.pipeline.clone().unwrap_or_else(|| "(unknown)".to_owned()));
    let rooms = rooms(holdings, groups.iter().map(|(_, runs)| runs.iter().map(|(run, _)| *run).collect()));
    groups.into_iter().zip(rooms).map(|((name, runs), room)| Pipeline { name, room, runs }).collect()
}

fn row(name: &str, runs: &str, room: Room) -> Vec<String> {
    vec![name.to_owned(), runs.to_owned(), out::bytes(room.own), out::bytes(room.shared)]
}

/// How much room each group of runs takes.
fn rooms<'a>(holdings: &Holdings, groups: impl Iterator<Item = Vec<&'a Holding>>) -> Vec<Room> {
    let groups: Vec<Vec<&Holding>> = groups.collect();
    let objects = |runs: &Vec<&Holding>| -> BTreeSet<Digest> {
        runs.iter().flat_map(|run| holdings.objects_of(&run.results)).collect()
    };
    let of_groups: Vec<BTreeSet<Digest>> = groups.iter().map(objects).collect();
    let mut names: BTreeMap<Digest, usize> = BTreeMap::new();
    of_groups.iter().flatten().for_each(|object| *names.entry(*object).or_default() += 1);
    let room = |(runs, objects): (&Vec<&Holding>, &BTreeSet<Digest>)| {
        let mut room = Room { own: runs.iter().map(|run| run.folder_bytes).sum(), shared: 0 };
        for object in objects {
            let part = if names[object] == 1 { &mut room.own } else { &mut room.shared };
            *part += holdings.bytes(*object);
        }
        room
    };
    groups.iter().zip(&of_groups).map(room).collect()
}

/// The room that everything takes, in bytes.
#[derive(Debug, Serialize)]
struct Total {
    bytes: u64,
    results: u64,
    run_folders: u64,
    unused_results: u64,
    set_aside: u64,
}

impl Total {
    fn of(global: &Global, holdings: &Holdings) -> Self {
        let used: BTreeSet<Digest> = holdings.runs.iter().flat_map(|run| holdings.objects_of(&run.results)).collect();
        let unused = holdings.objects.iter().filter(|(object, _)| !used.contains(object));
        let results = holdings.objects.values().sum();
        let run_folders = holdings.runs.iter().map(|run| run.folder_bytes).sum();
        let set_aside = bytes_below(&global.artifacts.join("bad"));
        let unused_results = unused.map(|(_, bytes)| bytes).sum();
        Self { bytes: results + run_folders + set_aside, results, run_folders, unused_results, set_aside }
    }

    fn print(&self) {
        out::line(&out::bold(&format!(
            "{}: results {}, folders of runs {}",
            out::bytes(self.bytes),
            out::bytes(self.results),
            out::bytes(self.run_folders)
        )));
        if self.unused_results + self.set_aside > 0 {
            out::line(&out::dim(&format!(
                "{} of results are unused, and damaged files of {} are set aside; `carl-pipe gc` removes both",
                out::bytes(self.unused_results),
                out::bytes(self.set_aside)
            )));
        }
    }
}
