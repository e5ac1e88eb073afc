//! `carl-pipe log` lists runs. `carl-pipe show` prints the results of one run.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

use serde_json::{Value, json};

use super::{
    Global,
    exit::{Error, Exit},
    out::{self, duration},
};
use crate::{
    node_name::without_member,
    report::{
        groups::grouped,
        headline::{Headline, headline},
    },
    run::{
        events::NodeState,
        holdings::Standing,
        manifest::{Manifest, Unreadable},
        marks::Marks,
        node::NodeRecord,
        runs::{self, Found},
    },
    stage::Kind,
    store::ResultStore,
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

/// The arguments of `show`.
#[derive(Debug, clap::Args)]
pub(crate) struct ShowArgs {
    /// The run: `latest`, `latest~1`, a tag, a pipeline, its id, or the beginning of its id.
    #[arg(value_name = "RUN", default_value = "latest")]
    run: String,
    /// Show only this stage or node, with its parameters and files.
    #[arg(value_name = "NODE")]
    node: Option<String>,
    /// Print the manifest as JSON.
    #[arg(long)]
    json: bool,
}

/// With more nodes than this, the table has one row for each stage.
const ROWS: usize = 100;

/// Lists runs. A run whose manifest cannot be read has a row that says so.
pub(crate) fn log(global: &Global, args: &Args, kinds: &[Kind]) -> Result<Exit, Error> {
    let all = global.runs();
    let mut rows =
        vec![["run", "pipeline", "state", "score", "seed", "nodes", "time", "changes", ""].map(out::bold).to_vec()];
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
        row.push(match &self.marks {
            Ok(marks) => told(marks),
            Err(why) => out::red(why),
        });
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

/// Pin, tags and note of a run.
fn told(marks: &Marks) -> String {
    let pin = marks.pinned.then(|| out::bold("pinned"));
    let tags = marks.tags.iter().map(|tag| out::bold(&format!("#{tag}")));
    pin.into_iter().chain(tags).chain(marks.note.clone()).collect::<Vec<_>>().join(" ")
}

fn coloured(standing: Standing) -> String {
    match standing {
        Standing::Finished => out::green(standing.word()),
        Standing::Failed | Standing::Killed | Standing::Unreadable => out::red(standing.word()),
        Standing::Running | Standing::Interrupted => out::yellow(standing.word()),
    }
}

/// Shows a run.
pub(crate) fn show(global: &Global, args: &ShowArgs) -> Result<Exit, Error> {
    let manifest = global.manifest(&args.run)?;
    let nodes = named(&manifest, args.node.as_deref())?;
    if args.json {
        out::json(&if args.node.is_some() { json!(nodes) } else { json!(manifest) });
        return Ok(Exit::Ok);
    }
    let run_dir = global.runs().join(&manifest.run);
    print_head(&manifest, Standing::of(&run_dir, Some(manifest.state)));
    if nodes.len() > ROWS && !global.verbose {
        out::print(&out::table(&by_stage(&nodes)));
        out::line(&out::dim("to list every node, add -v or name a stage or a member of a suite"));
        return Ok(Exit::Ok);
    }
    out::print(&out::table(&nodes.iter().map(|node| row(node)).collect::<Vec<_>>()));
    if args.node.is_some() {
        let store = global.store_to_read()?;
        for node in &nodes {
            out::line(&format!("\n{} {}", out::bold(&node.about.name), node.about.work.params));
            out::print(&out::table(&files(&store, node)?));
        }
    }
    Ok(Exit::Ok)
}

/// The nodes with this name: of a node, of a stage or of a member of a suite. All nodes if there is no name.
fn named<'a>(manifest: &'a Manifest, name: Option<&str>) -> Result<Vec<&'a NodeRecord>, Error> {
    let Some(name) = name else { return Ok(manifest.nodes.iter().collect()) };
    let is_named = |node: &&NodeRecord| {
        let member = &manifest.members[node.about.member].name;
        node.about.name == name
            || node.about.stage == name
            || without_member(&node.about.stage) == name
            || (!member.is_empty() && member == name)
    };
    let nodes: Vec<&NodeRecord> = manifest.nodes.iter().filter(is_named).collect();
    if nodes.is_empty() {
        return Err(Error::usage(format!("run {} has no stage or node `{name}`", manifest.run)));
    }
    Ok(nodes)
}

/// Prints what is known of a run as a whole.
fn print_head(manifest: &Manifest, standing: Standing) {
    out::line(&format!("{} {}  {}", out::bold(&manifest.pipeline), manifest.run, coloured(standing)));
    out::line(&format!(
        "started {} on {} ({} cores), took {}, recording took {:.2}% of the nodes' time",
        manifest.started,
        manifest.host.name,
        manifest.host.cores,
        duration(manifest.wall_secs),
        100.0 * manifest.recorder_secs / manifest.node_secs.max(1e-9)
    ));
    out::line(&format!("command: {}", out::command(&manifest.argv)));
    if let Some(commit) = &manifest.commit {
        out::line(&format!("carl-pipe {} of commit {commit}", manifest.carl_pipe));
    }
}

/// A row for each stage, with the number of its nodes in each state.
fn by_stage(nodes: &[&NodeRecord]) -> Vec<Vec<String>> {
    let row = |(stage, own): &(&str, Vec<&NodeRecord>)| {
        let mut counts: BTreeMap<String, usize> = BTreeMap::new();
        own.iter().for_each(|node| *counts.entry(row(node).swap_remove(1)).or_default() += 1);
        let states: Vec<String> = counts.iter().map(|(state, count)| format!("{state} {count}")).collect();
        let secs = own.iter().map(|node| node.outcome.secs).sum();
        vec![format!("{stage} x{}", own.len()), states.join(", "), duration(secs)]
    };
    grouped(nodes.iter().copied(), |node| node.about.stage.as_str()).iter().map(row).collect()
}

/// Name, state, time, output and metrics of a node.
fn row(node: &NodeRecord) -> Vec<String> {
    let state =
        serde_json::to_value(node.outcome.state).ok().and_then(|it| it.as_str().map(str::to_owned)).unwrap_or_default();
    let metrics = node.outcome.metrics.iter().map(|(name, value)| format!("{name} {}", out::number(*value)));
    let output = node.outcome.output.map_or_else(String::new, |digest| digest.short());
    vec![node.about.name.clone(), state, duration(node.outcome.secs), output, metrics.collect::<Vec<_>>().join(", ")]
}

/// The paths of the files and of the recording of a node.
fn files(store: &dyn ResultStore, node: &NodeRecord) -> Result<Vec<Vec<String>>, Error> {
    let entry = node.outcome.key.map_or(Ok(None), |key| store.entry(key))?;
    let Some(entry) = entry.filter(|entry| Some(entry.output) == node.outcome.output) else {
        return Ok(vec![vec!["  its output is no longer in the store".to_owned()]]);
    };
    let path = |object| store.path_of(object).map_or_else(String::new, |path| path.display().to_string());
    let row = |name: &str, object| vec![format!("  {name}"), path(object)];
    let files = entry.files.iter().map(|file| row(&file.name, file.object));
    Ok(files.chain(entry.recording.iter().map(|recording| row("recording", recording.object))).collect())
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
