//! `carl-pipe plot`: the learning curve and the latent maps of a run, as SVG pictures.

mod curve;
mod strip;
mod svg;

use std::{fs, path::PathBuf};

use super::{
    Global,
    exit::{Error, Exit},
    out,
};
use crate::{
    artifact::{Artifact, Evaluation, LatentMap},
    engine::{
        events::NodeState,
        manifest::{Manifest, NodeRecord},
        runs,
        store::Store,
    },
    stage::Kind,
};

/// The arguments of `plot`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Writes percent_goal.svg, the learning curve over rounds, and latent_map.svg, up to five maps \
of one point.

Examples:
  carl-pipe plot latest
  carl-pipe plot latest -o figures --point seed=3")]
pub(crate) struct Args {
    /// The run: `latest`, its id, or the beginning of its id.
    #[arg(value_name = "RUN", default_value = "latest")]
    run: String,
    /// Where to write the pictures; made if it is not there.
    #[arg(short, long, value_name = "DIR", default_value = ".")]
    output: PathBuf,
    /// Whose latent maps, such as `seed=3`; may be given again. The first point if not given.
    #[arg(long, value_name = "PATH=VALUE", value_parser = axis)]
    point: Vec<(String, String)>,
}

fn axis(text: &str) -> Result<(String, String), &'static str> {
    let (path, value) = text.split_once('=').ok_or("write it as PATH=VALUE, such as `seed=3`")?;
    Ok((path.to_owned(), value.to_owned()))
}

/// Writes the pictures of a run.
pub(crate) fn plot(global: &Global, args: &Args, kinds: &[Kind]) -> Result<Exit, Error> {
    let store = global.store()?;
    let run_dir = runs::find(&store.runs(), &args.run).map_err(|error| Error::usage(error.to_string()))?;
    let manifest = Manifest::read(&run_dir)?;
    let evaluations = finished(&manifest, kinds, Evaluation::TYPE);
    let maps = finished(&manifest, kinds, LatentMap::TYPE);
    if let ([], []) = (&evaluations[..], &maps[..]) {
        return Err(missing(
            &manifest,
            "neither an evaluation nor a latent map",
            "percent_goal.svg and latent_map.svg",
        ));
    }
    let curve = (!evaluations.is_empty()).then(|| curve::draw(&manifest.pipeline, &evaluations));
    let strip = if maps.is_empty() { None } else { Some(map_strip(&store, &manifest, &maps, &args.point)?) };
    fs::create_dir_all(&args.output)
        .map_err(|error| Error::new(Exit::Store, format!("cannot make {}: {error}", args.output.display())))?;
    for (name, picture) in [("percent_goal.svg", &curve), ("latent_map.svg", &strip)] {
        if let Some(picture) = picture {
            let path = args.output.join(name);
            fs::write(&path, picture)
                .map_err(|error| Error::new(Exit::Store, format!("cannot write {}: {error}", path.display())))?;
            out::line(&path.display().to_string());
        }
    }
    match (curve, strip) {
        (None, _) => Err(missing(&manifest, "no evaluation", "percent_goal.svg")),
        (_, None) => Err(missing(&manifest, "no latent map", "latent_map.svg")),
        _ => Ok(Exit::Ok),
    }
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
