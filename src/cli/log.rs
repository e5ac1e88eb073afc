//! `carl-pipe log`: lists runs.

use std::{collections::BTreeSet, path::Path};

use serde_json::{Value, json};

use super::{
    Global,
    exit::{Error, Exit},
    out::{self, duration},
};
use crate::{
    report::headline::{Headline, headline},
    run::{
        events::NodeState,
        holdings::Standing,
        manifest::{Manifest, Unreadable},
        marks::Marks,
        runs::{self, Found},
    },
    stage::Kind,
};

/// The arguments of `log`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The largest number of runs to list.
    #[arg(short = 'n', long, value_name = "N", default_value_t = 20)]
    number: usize,
    /// Print one JSON object for each run.
    #[arg(long)]
    json: bool,
}

/// Lists runs. A run whose manifest cannot be read has a row that says so.
pub(crate) fn log(global: &Global, args: &Args, kinds: &[Kind]) -> Result<Exit, Error> {
    let all = global.runs();
    let header = ["run", "pipeline", "state", "score", "seed", "nodes", "time", "changes", "marks", "note"];
    let mut rows = vec![header.map(out::bold).to_vec()];
    for (found, manifest) in runs::manifests(&all)?.take(args.number) {
        let listed = Listed::new(found, manifest, &all, kinds);
        if args.json {
            out::json(&listed.json());
        } else {
            rows.push(listed.row());
        }
    }
    if args.json {
        return Ok(Exit::Ok);
    }
    if rows.len() == 1 {
        out::note(&format!("there are no runs in {} yet; start one with `carl-pipe run PIPELINE`", all.display()));
        return Ok(Exit::Ok);
    }
    out::print(&out::table(&rows));
    Ok(Exit::Ok)
}

/// A run in the list.
struct Listed {
    id: String,
    number: Option<u64>,
    /// Its manifest, or what is wrong with it.
    manifest: Result<Manifest, &'static str>,
    pipeline: String,
    standing: Standing,
    headline: Option<Headline>,
    /// What the user says about it, or why that cannot be read.
    marks: Result<Marks, String>,
}

impl Listed {
    fn new(found: Found, manifest: Result<Manifest, Unreadable>, runs: &Path, kinds: &[Kind]) -> Self {
        let path = runs.join(&found.id);
        let pipeline = manifest.as_ref().ok().map(|manifest| manifest.pipeline.clone());
        Self {
            standing: Standing::of(&path, manifest.as_ref().ok().map(|manifest| manifest.state)),
            headline: manifest.as_ref().ok().and_then(|manifest| headline(manifest, kinds)),
            pipeline: pipeline.or_else(|| runs::pipeline_of(&path)).unwrap_or_default(),
            manifest: manifest.map_err(|error| error.short()),
            marks: Marks::read(&path).map_err(|error| error.to_string()),
            number: found.number,
            id: found.id,
        }
    }

    fn json(&self) -> Value {
        let marks = self.marks.clone().unwrap_or_default();
        let mut json = json!({
            "version": 1, "run": self.id, "number": self.number, "pipeline": self.pipeline,
            "state": self.standing.word(), "problem": self.manifest.as_ref().err(), "pinned": marks.pinned,
            "note": marks.note, "tags": marks.tags,
        });
        if let Ok(manifest) = &self.manifest {
            let [ran, cached] = counts(manifest);
            json["headline"] =
                json!(self.headline.map(|it| json!({"metric": it.metric, "mean": it.mean, "models": it.models})));
            for (name, value) in [
                ("started", json!(manifest.started)),
                ("executed", json!(ran)),
                ("cached", json!(cached)),
                ("nodes", json!(manifest.nodes.len())),
                ("wall_secs", json!(manifest.wall_secs)),
                ("seeds", json!(seeds(manifest))),
                ("changes", json!(changes(&manifest.argv))),
                ("argv", json!(manifest.argv)),
            ] {
                json[name] = value;
            }
        }
        json
    }

    fn row(&self) -> Vec<String> {
        let mut row = vec![self.id.clone(), self.pipeline.clone(), coloured(self.standing)];
        match &self.manifest {
            Ok(manifest) => row.extend([
                self.headline.map_or_else(String::new, |it| format!("{} {}", it.metric, out::number(it.mean))),
                ranges(&seeds(manifest)),
                nodes(manifest),
                duration(manifest.wall_secs),
                changes(&manifest.argv).join(" "),
            ]),
            Err(problem) => row.extend([out::red(problem), String::new(), String::new(), String::new(), String::new()]),
        }
        match &self.marks {
            Ok(marks) => row.extend([told(marks), marks.note.clone().unwrap_or_default()]),
            Err(why) => row.push(out::red(why)),
        }
        row
    }
}

/// How many nodes ran and how many were cached.
fn counts(manifest: &Manifest) -> [usize; 2] {
    [NodeState::Ran, NodeState::Cached]
        .map(|state| manifest.nodes.iter().filter(|node| node.outcome.state == state).count())
}

fn nodes(manifest: &Manifest) -> String {
    let ([ran, cached], all) = (counts(manifest), manifest.nodes.len());
    let of = if ran + cached < all { format!(" of {all}") } else { String::new() };
    match (ran, cached) {
        (ran, 0) => format!("{ran} ran{of}"),
        (0, cached) => format!("{cached} cached{of}"),
        (ran, cached) => format!("{ran} ran, {cached} cached{of}"),
    }
}

/// The seeds of the nodes, in order.
fn seeds(manifest: &Manifest) -> Vec<u64> {
    let seeds: BTreeSet<u64> = manifest.nodes.iter().map(|node| node.about.work.stream.seed).collect();
    seeds.into_iter().collect()
}

/// `0-4, 7` for 0, 1, 2, 3, 4, 7.
fn ranges(numbers: &[u64]) -> String {
    let mut ranges: Vec<(u64, u64)> = Vec::new();
    for &number in numbers {
        match ranges.last_mut() {
            Some((_, last)) if *last + 1 == number => *last = number,
            _ => ranges.push((number, number)),
        }
    }
    let text = |(first, last): &(u64, u64)| if first == last { first.to_string() } else { format!("{first}-{last}") };
    ranges.iter().map(text).collect::<Vec<_>>().join(", ")
}

/// What a command changes of its pipeline file: the values of `-S` and `--sweep`.
fn changes(argv: &[String]) -> Vec<String> {
    let mut found = Vec::new();
    let mut words = argv.iter().map(String::as_str);
    while let Some(word) = words.next() {
        match word {
            "-S" | "--set" | "--sweep" => found.extend(words.next()),
            _ => {
                let attached = ["--set=", "--sweep=", "-S"].iter().find_map(|option| word.strip_prefix(option));
                found.extend(attached.map(|value| value.trim_start_matches('=')));
            }
        }
    }
    found.into_iter().map(str::to_owned).collect()
}

/// Pin and tags of a run.
fn told(marks: &Marks) -> String {
    let pin = marks.pinned.then(|| out::bold("pinned"));
    let tags = marks.tags.iter().map(|tag| out::bold(&format!("#{tag}")));
    pin.into_iter().chain(tags).collect::<Vec<_>>().join(" ")
}

pub(super) fn coloured(standing: Standing) -> String {
    match standing {
        Standing::Finished => out::green(standing.word()),
        Standing::Failed | Standing::Killed | Standing::Unreadable => out::red(standing.word()),
        Standing::Running | Standing::Interrupted => out::yellow(standing.word()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_changes_of_a_command_are_found_however_they_are_written() {
        let argv = "carl-pipe run a.toml -S a=1 -Sb=2 --set=c=3 --set d=4 --sweep seed=0..5 --sweep=e=1,2 -k";
        let argv: Vec<String> = argv.split(' ').map(str::to_owned).collect();
        assert_eq!(changes(&argv), ["a=1", "b=2", "c=3", "d=4", "seed=0..5", "e=1,2"]);
    }

    #[test]
    fn seeds_read_as_ranges() {
        assert_eq!(ranges(&[0, 1, 2, 3, 7, 9, 10]), "0-3, 7, 9-10");
    }
}
