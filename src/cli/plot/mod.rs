//! `carl-pipe plot`: learning curves and latent maps of runs, as SVG pictures.

mod curve;
mod samples;
mod strip;
mod svg;

use std::{
    collections::BTreeSet,
    fs,
    path::{Path, PathBuf},
};

use super::{
    Global,
    exit::{Error, Exit},
    out,
    table::all_outcomes,
};
use crate::{
    artifact::{Artifact, Evaluation, LatentMap},
    pipeline::Member,
    report::outcomes::Outcome,
    run::{
        events::NodeState,
        manifest::{Manifest, NodeRecord},
        runs,
    },
    stage::Kind,
    store::Store,
};

/// The arguments of `plot`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Of one pipeline: percent_goal.svg, the learning curve over rounds, and latent_map.svg, up to \
five maps of one point. Of several pipelines or runs, or of a sweep over `….samples`: learning_curves_TASK.svg, the \
share of time at the goal by samples, each pipeline with its band over seeds.

Examples:
  carl-pipe plot latest
  carl-pipe plot latest -o figures --point seed=3
  carl-pipe plot latest --member planar_online            one pipeline of a suite
  carl-pipe run pipelines/planar_offline.toml --sweep bootstrap.samples=1000,2000,5000 --sweep seed=0..5
  carl-pipe plot latest 20261122-0748 --band ci           with the online curve of another run")]
pub(crate) struct Args {
    /// The runs: `latest`, ids, or beginnings of ids.
    #[arg(value_name = "RUN", default_value = "latest")]
    runs: Vec<String>,
    /// Where to write the pictures; made if it is not there.
    #[arg(short, long, value_name = "DIR", default_value = ".")]
    output: PathBuf,
    /// Whose latent maps, such as `seed=3`; may be given again. The first point if not given.
    #[arg(long, value_name = "PATH=VALUE", value_parser = axis)]
    point: Vec<(String, String)>,
    /// Only this member of a suite.
    #[arg(long, value_name = "NAME")]
    member: Option<String>,
    /// What bands by samples are: se (standard errors) or ci (95 % bootstrap intervals over models).
    #[arg(long, value_name = "WHAT", default_value = "se", value_enum, hide_possible_values = true)]
    band: Band,
}

/// What a band around a mean is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Band {
    Se,
    Ci,
}

fn axis(text: &str) -> Result<(String, String), &'static str> {
    let (path, value) = text.split_once('=').ok_or("write it as PATH=VALUE, such as `seed=3`")?;
    Ok((path.to_owned(), value.to_owned()))
}

/// Writes the pictures of runs.
pub(crate) fn plot(global: &Global, args: &Args, kinds: &[Kind]) -> Result<Exit, Error> {
    let store = global.store()?;
    let mut outcomes = all_outcomes(&store, &args.runs, kinds)?;
    if let Some(member) = &args.member {
        outcomes.retain(|outcome| outcome.member.name == *member);
        if outcomes.is_empty() {
            return Err(Error::usage(format!("no member `{member}` has an evaluation in {}", args.runs.join(", "))));
        }
    }
    let of_rounds = outcomes.iter().filter(|outcome| outcome.round.is_some());
    let pipelines: BTreeSet<_> = outcomes.iter().map(|it| (&it.member.pipeline, &it.member.labels)).collect();
    let has_sizes = outcomes.iter().any(|it| it.point.iter().any(|(axis, _)| axis.ends_with(".samples")));
    if args.runs.len() > 1 || pipelines.len() > 1 || has_sizes || (of_rounds.count() == 0 && !outcomes.is_empty()) {
        return by_samples(&outcomes, args);
    }
    let run_dir = runs::find(&store.runs(), &args.runs[0]).map_err(|error| Error::usage(error.to_string()))?;
    let mut manifest = Manifest::read(&run_dir)?;
    if let Some(wanted) = &args.member {
        let of_member = |node: &NodeRecord| manifest.members[node.member].name == *wanted;
        let (nodes, pipeline) = (manifest.nodes.iter().filter(|it| of_member(it)).cloned().collect(), wanted.clone());
        (manifest.nodes, manifest.pipeline) = (nodes, pipeline);
    }
    by_round(&store, &manifest, args, kinds)
}

/// Writes the learning curves by samples, a picture for each task.
fn by_samples(outcomes: &[Outcome], args: &Args) -> Result<Exit, Error> {
    let pictures = samples::curves(outcomes).into_iter().map(|(task, curves)| {
        let plain = |c: char| if c.is_ascii_alphanumeric() || c == '_' || c == '.' { c } else { '-' };
        let name = format!("learning_curves_{}.svg", task.replace(", ", "-").chars().map(plain).collect::<String>());
        (name, samples::draw(&task, &curves, args.band))
    });
    write(&args.output, pictures)?;
    Ok(Exit::Ok)
}

fn write(folder: &Path, pictures: impl Iterator<Item = (String, String)>) -> Result<(), Error> {
    fs::create_dir_all(folder)
        .map_err(|error| Error::new(Exit::Store, format!("cannot make {}: {error}", folder.display())))?;
    for (name, picture) in pictures {
        let path = folder.join(name);
        fs::write(&path, picture)
            .map_err(|error| Error::new(Exit::Store, format!("cannot write {}: {error}", path.display())))?;
        out::line(&path.display().to_string());
    }
    Ok(())
}

/// Writes the learning curve and the latent maps of one pipeline.
fn by_round(store: &Store, manifest: &Manifest, args: &Args, kinds: &[Kind]) -> Result<Exit, Error> {
    let evaluations = finished(manifest, kinds, Evaluation::TYPE);
    let maps = finished(manifest, kinds, LatentMap::TYPE);
    if let ([], []) = (&evaluations[..], &maps[..]) {
        return Err(missing(manifest, "neither an evaluation nor a latent map", "percent_goal.svg and latent_map.svg"));
    }
    let curve = evaluations
        .first()
        .map(|first| curve::draw(&manifest.pipeline, &evaluations, paper(&manifest.members[first.member])));
    let strip = if maps.is_empty() { None } else { Some(map_strip(store, manifest, &maps, &args.point)?) };
    let pictures = [("percent_goal.svg", &curve), ("latent_map.svg", &strip)];
    let drawn = pictures.into_iter().filter_map(|(name, picture)| Some((name.to_owned(), picture.clone()?)));
    write(&args.output, drawn)?;
    match (curve, strip) {
        (None, _) => Err(missing(manifest, "no evaluation", "percent_goal.svg")),
        (_, None) => Err(missing(manifest, "no latent map", "latent_map.svg")),
        _ => Ok(Exit::Ok),
    }
}

/// The paper's mean of a pipeline, as its label says: `68.0 ± 1.7` is drawn by its mean.
fn paper(member: &Member) -> Option<f64> {
    member.labels.get("paper")?.split_whitespace().next()?.parse().ok()
}

fn missing(manifest: &Manifest, what: &str, files: &str) -> Error {
    Error::usage(format!("run {} has {what} of a round, which {files} shows", manifest.run))
        .help("add stages of kind `evaluate` and `export_latent_map` with `loop = true`, or let the run go on")
}

/// The finished nodes of rounds that made such an artifact; where several stages make it, those of the first.
fn finished<'a>(manifest: &'a Manifest, kinds: &[Kind], artifact: &str) -> Vec<&'a NodeRecord> {
    let makes = |node: &&NodeRecord| kinds.iter().any(|kind| kind.name == node.kind && kind.output == artifact);
    let is_done = |node: &&NodeRecord| matches!(node.state, NodeState::Ran | NodeState::Cached);
    let mut nodes: Vec<_> =
        manifest.nodes.iter().filter(makes).filter(is_done).filter(|node| node.round.is_some()).collect();
    if let Some(first) = nodes.first().map(|node| node.stage.clone()) {
        nodes.retain(|node| node.stage == first);
    }
    nodes
}

/// The strip of maps of one point: the wanted one, else the first.
fn map_strip(
    store: &Store,
    manifest: &Manifest,
    maps: &[&NodeRecord],
    wanted: &[(String, String)],
) -> Result<String, Error> {
    let fits = |node: &&&NodeRecord| wanted.iter().all(|axis| node.point.contains(axis));
    let Some(first) = maps.iter().find(fits) else {
        let names = |point: &[(String, String)]| point.iter().map(|(path, value)| format!("{path}={value}")).collect();
        let mut points: Vec<Vec<String>> = maps.iter().map(|node| names(&node.point)).collect();
        points.dedup();
        points.sort();
        points.dedup();
        let all: Vec<String> = points.iter().map(|point| format!("`{}`", point.join(" "))).collect();
        let wanted: Vec<String> = names(wanted);
        let error = Error::usage(format!("run {} has no latent map of `{}`", manifest.run, wanted.join(" ")));
        return Err(if first_is_empty(&points) {
            error.help("its maps belong to no point; leave `--point` out")
        } else {
            error.help(format!("its points are {}", all.join(", ")))
        });
    };
    let mut rounds: Vec<&NodeRecord> = maps.iter().filter(|node| node.point == first.point).copied().collect();
    rounds.sort_by_key(|node| node.round);
    let mut panels = Vec::new();
    for at in strip::shown(rounds.len()) {
        panels.push((rounds[at].round.unwrap_or_default(), load(store, rounds[at])?));
    }
    let point: String = first.point.iter().map(|(path, value)| format!(", {path} {value}")).collect();
    Ok(strip::draw(&format!("{}{point}: latent space by round", manifest.pipeline), &panels))
}

fn first_is_empty(points: &[Vec<String>]) -> bool {
    points.first().is_none_or(Vec::is_empty)
}

/// Reads the map that a node made.
fn load(store: &Store, node: &NodeRecord) -> Result<LatentMap, Error> {
    let gone = |why: &str| {
        Error::new(Exit::Store, format!("cannot read what `{}` made: {why}", node.name))
            .help("run the pipeline again: only what is gone runs")
    };
    let entry = node.key.map_or(Ok(None), |key| store.entry(key))?;
    let entry = entry.filter(|entry| Some(entry.output) == node.output).ok_or_else(|| gone("it is gone"))?;
    let files = store.load(&entry)?.map_err(|(file, why)| gone(&format!("{file}: {why}")))?;
    Ok(LatentMap::load(&files)?)
}
