//! `carl-pipe plot`: writes learning curves and latent maps of runs, as SVG pictures.

use std::{collections::BTreeSet, fs, path::PathBuf};

use super::{
    Global,
    exit::{Error, Exit},
    out,
    output::refuse_inputs,
    table::all_outcomes,
};
use crate::{
    artifact::{Artifact, LatentMap},
    report::{
        chart::{self, Panel},
        outcomes::{Outcome, is_done, point_text},
    },
    run::{manifest::Manifest, node::NodeRecord},
    stage::Kind,
    store::{LocalStore, ResultStore as _},
};

/// The arguments of `plot`.
#[derive(Debug, clap::Args)]
#[command(after_help = "For one pipeline, `plot` writes percent_goal.svg, the learning curve by round, and \
latent_map.svg, up to five latent maps of one point. For several pipelines or runs, or for a sweep over `….samples`, it \
writes learning_curves_TASK.svg: the share of time at the goal by samples, with a band over seeds for each pipeline.

Examples:
  carl-pipe plot latest
  carl-pipe plot latest -o figures --point seed=3
  carl-pipe plot latest --member planar_online            one pipeline of a suite
  carl-pipe run pipelines/planar_offline.toml --sweep bootstrap.samples=1000,2000,5000 --sweep seed=0..5
  carl-pipe plot latest 20261122-0748 --band ci           with the online curve of another run")]
pub(crate) struct Args {
    /// The runs: `latest`, `latest~1`, tags, pipelines, ids, or beginnings of ids.
    #[arg(value_name = "RUN", default_value = "latest")]
    runs: Vec<String>,
    /// The folder for the pictures; made if it does not exist.
    #[arg(short, long, value_name = "DIR", default_value = ".")]
    output: PathBuf,
    /// The point of the matrix whose latent maps are drawn, such as `seed=3`; may be given again. The first point if
    /// not given.
    #[arg(long, value_name = "PATH=VALUE", value_parser = axis)]
    point: Vec<(String, String)>,
    /// Only this member of a suite.
    #[arg(long, value_name = "NAME")]
    member: Option<String>,
    /// The bands by samples: se (standard errors) or ci (95 % bootstrap intervals over models).
    #[arg(long, value_name = "WHAT", default_value = "se", value_enum, hide_possible_values = true)]
    band: Band,
}

/// What a band around a mean shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Band {
    Se,
    Ci,
}

impl From<Band> for chart::Band {
    fn from(band: Band) -> Self {
        match band {
            Band::Se => Self::StandardError,
            Band::Ci => Self::Interval,
        }
    }
}

/// A picture and the name of its file.
struct Picture {
    name: String,
    svg: String,
}

fn axis(text: &str) -> Result<(String, String), &'static str> {
    let (path, value) = text.split_once('=').ok_or("write it as PATH=VALUE, such as `seed=3`")?;
    Ok((path.to_owned(), value.to_owned()))
}

/// Writes the pictures of runs.
pub(crate) fn plot(global: &Global, args: &Args, kinds: &[Kind]) -> Result<Exit, Error> {
    let mut outcomes = all_outcomes(global, &args.runs, kinds)?;
    if let Some(member) = &args.member {
        outcomes.retain(|outcome| outcome.member.name == *member);
        if outcomes.is_empty() {
            return Err(Error::usage(format!("no member `{member}` has an evaluation in {}", args.runs.join(", "))));
        }
    }
    let pipelines: BTreeSet<_> = outcomes.iter().map(|it| (&it.member.pipeline, &it.member.labels)).collect();
    let has_sizes = outcomes.iter().any(|it| it.point.iter().any(|(axis, _)| axis.ends_with(".samples")));
    let has_rounds = outcomes.is_empty() || outcomes.iter().any(|outcome| outcome.round.is_some());
    if args.runs.len() > 1 || pipelines.len() > 1 || has_sizes || !has_rounds {
        write(args, global, by_samples(&outcomes, args.band))?;
        return Ok(Exit::Ok);
    }
    by_round(&OneRun::read(global, args, kinds)?, outcomes, args, global)
}

/// The learning curves by samples, one picture for each task.
fn by_samples(outcomes: &[Outcome], band: Band) -> Vec<Picture> {
    let plain = |c: char| if c.is_ascii_alphanumeric() || c == '_' || c == '.' { c } else { '-' };
    let picture = |(task, svg): (String, String)| {
        let task: String = task.replace(", ", "-").chars().map(plain).collect();
        Picture { name: format!("learning_curves_{task}.svg"), svg }
    };
    chart::by_samples(outcomes, band.into()).into_iter().map(picture).collect()
}

fn write(args: &Args, global: &Global, pictures: Vec<Picture>) -> Result<(), Error> {
    let folder = &args.output;
    fs::create_dir_all(folder)
        .map_err(|error| Error::new(Exit::Store, format!("cannot make {}: {error}", folder.display())))?;
    for Picture { name, svg } in pictures {
        let path = folder.join(name);
        refuse_inputs(&path, &[], &global.artifacts).map_err(|error| Error::usage(error.to_string()))?;
        fs::write(&path, svg)
            .map_err(|error| Error::new(Exit::Store, format!("cannot write {}: {error}", path.display())))?;
        out::line(&path.display().to_string());
    }
    Ok(())
}

/// One pipeline of one run.
struct OneRun<'a> {
    store: LocalStore,
    kinds: &'a [Kind],
    run: String,
    /// The pipeline's name, or its name in the suite.
    pipeline: String,
    nodes: Vec<NodeRecord>,
}

/// Writes the learning curve by round and the latent maps of one pipeline.
fn by_round(run: &OneRun<'_>, outcomes: Vec<Outcome>, args: &Args, global: &Global) -> Result<Exit, Error> {
    let mut measured: Vec<Outcome> = outcomes.into_iter().filter(|outcome| outcome.round.is_some()).collect();
    if let Some(first) = measured.first().map(|outcome| outcome.stage.clone()) {
        measured.retain(|outcome| outcome.stage == first);
    }
    let maps = run.maps();
    let curve_name = format!("{}.svg", measured.first().map_or("percent_goal", |outcome| outcome.headline));
    if measured.is_empty() && maps.is_empty() {
        let files = format!("{curve_name} and latent_map.svg");
        return Err(run.lacks("neither an evaluation nor a latent map", &files));
    }
    // The curve first, since it can be drawn even where a map cannot be read.
    if !measured.is_empty() {
        let svg = chart::by_round(&run.pipeline, &measured);
        write(args, global, vec![Picture { name: curve_name.clone(), svg }])?;
    }
    if !maps.is_empty() {
        let svg = run.latent_maps(&maps, &args.point)?;
        write(args, global, vec![Picture { name: "latent_map.svg".to_owned(), svg }])?;
    }
    if measured.is_empty() {
        return Err(run.lacks("no evaluation", &curve_name));
    }
    if maps.is_empty() {
        return Err(run.lacks("no latent map", "latent_map.svg"));
    }
    Ok(Exit::Ok)
}

impl<'a> OneRun<'a> {
    fn read(global: &Global, args: &Args, kinds: &'a [Kind]) -> Result<Self, Error> {
        let Manifest { run, pipeline, members, mut nodes, .. } = global.manifest(&args.runs[0])?;
        if let Some(wanted) = &args.member {
            nodes.retain(|node| members[node.about.member].name == *wanted);
        }
        let pipeline = args.member.clone().unwrap_or(pipeline);
        Ok(Self { store: global.store_to_read()?, kinds, run, pipeline, nodes })
    }

    fn lacks(&self, what: &str, files: &str) -> Error {
        Error::usage(format!("run {} has {what} of a round, which {files} shows", self.run)).help(
            "add stages of kind `evaluate` and `export_latent_map` with `loop = true`, or wait until the run ends",
        )
    }

    /// The finished nodes of rounds that made latent maps. Where several stages make them, those of the first.
    fn maps(&self) -> Vec<&NodeRecord> {
        let makes = |node: &NodeRecord| {
            self.kinds.iter().any(|kind| kind.name == node.about.work.kind && kind.output == LatentMap::TYPE)
        };
        let done = self.nodes.iter().filter(|node| node.about.round.is_some() && makes(node) && is_done(node));
        let mut maps: Vec<&NodeRecord> = done.collect();
        if let Some(first) = maps.first().map(|node| node.about.stage.clone()) {
            maps.retain(|node| node.about.stage == first);
        }
        maps
    }

    /// The latent maps of one point: the wanted one, else the first.
    fn latent_maps(&self, maps: &[&NodeRecord], wanted: &[(String, String)]) -> Result<String, Error> {
        let fits = |node: &&&NodeRecord| wanted.iter().all(|axis| node.about.point.contains(axis));
        let first = maps.iter().find(fits).ok_or_else(|| self.no_such_point(maps, wanted))?;
        let mut rounds: Vec<&NodeRecord> =
            maps.iter().filter(|node| node.about.point == first.about.point).copied().collect();
        rounds.sort_by_key(|node| node.about.round);
        let mut panels = Vec::new();
        for at in chart::shown(rounds.len()) {
            panels.push(Panel { round: rounds[at].about.round.unwrap_or_default(), map: self.load(rounds[at])? });
        }
        let point: String = first.about.point.iter().map(|(path, value)| format!(", {path} {value}")).collect();
        Ok(chart::latent_maps(&format!("{}{point}: latent space by round", self.pipeline), &panels))
    }

    fn no_such_point(&self, maps: &[&NodeRecord], wanted: &[(String, String)]) -> Error {
        let error = Error::usage(format!("run {} has no latent map of `{}`", self.run, point_text(wanted)));
        let points: BTreeSet<String> = maps.iter().map(|node| point_text(&node.about.point)).collect();
        if points.iter().all(String::is_empty) {
            return error.help("its maps belong to no point; leave `--point` out");
        }
        let points: Vec<String> = points.iter().map(|point| format!("`{point}`")).collect();
        error.help(format!("its points are {}", points.join(", ")))
    }

    /// Reads the map that a node made.
    fn load(&self, node: &NodeRecord) -> Result<LatentMap, Error> {
        let unreadable = |why: &str| {
            Error::new(Exit::Store, format!("cannot read the output of `{}`: {why}", node.about.name))
                .help("run the pipeline again; only what is missing runs")
        };
        let kind = self.kinds.iter().find(|kind| kind.name == node.about.work.kind);
        if let Some(kind) = kind.filter(|kind| kind.version != node.about.work.version) {
            let (name, made, known) = (kind.name, node.about.work.version, kind.version);
            return Err(unreadable(&format!(
                "version {made} of `{name}` made it, this carl-pipe reads version {known}"
            )));
        }
        let entry = node.outcome.key.map_or(Ok(None), |key| self.store.entry(key))?;
        let entry =
            entry.filter(|entry| Some(entry.output) == node.outcome.output).ok_or_else(|| unreadable("it is gone"))?;
        let files = self.store.load(&entry).map_err(|error| unreadable(&error.to_string()))?;
        Ok(LatentMap::load(&files)?)
    }
}
