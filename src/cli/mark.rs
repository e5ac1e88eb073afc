//! `carl-pipe pin`, `unpin` and `tag`: what a user says about a run.

use std::path::{Path, PathBuf};

use super::{
    Global,
    exit::{Error, Exit},
    out,
};
use crate::run::{
    marks::{Marks, why_no_tag},
    runs,
};

/// The arguments of `pin`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  carl-pipe pin latest --note \"the figure of section 5\"
  carl-pipe pin planar_online                             the newest run of this pipeline")]
pub(crate) struct PinArgs {
    /// The run: `latest`, `latest~1`, a tag, a pipeline (its newest run), a run id, or the beginning of an id.
    #[arg(value_name = "RUN", default_value = "latest")]
    run: String,
    /// What the run is for; `log` shows it.
    #[arg(long, value_name = "TEXT")]
    note: Option<String>,
}

/// The arguments of `unpin`.
#[derive(Debug, clap::Args)]
pub(crate) struct UnpinArgs {
    /// The run, as for `pin`.
    #[arg(value_name = "RUN", default_value = "latest")]
    run: String,
}

/// The arguments of `tag`.
#[derive(Debug, clap::Args)]
#[command(after_help = "A tag belongs to one run: giving it to another run takes it from the first. `gc` keeps a run \
with a tag.

Examples:
  carl-pipe tag latest best
  carl-pipe table best
  carl-pipe tag best --remove")]
pub(crate) struct TagArgs {
    /// The run, as for `pin`.
    #[arg(value_name = "RUN")]
    run: String,
    /// The tag: letters, digits, `-`, `_` and `.`, beginning with a letter.
    #[arg(value_name = "NAME", required_unless_present = "remove")]
    name: Option<String>,
    /// Remove the tag NAME; without NAME, all tags of the run.
    #[arg(long)]
    remove: bool,
}

/// The folder and the id of a run.
struct Marked {
    path: PathBuf,
    id: String,
}

impl Marked {
    fn find(global: &Global, run: &str) -> Result<Self, Error> {
        let path = runs::find(&global.runs(), run)?;
        let id = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        Ok(Self { path, id })
    }

    /// Changes the marks. Damaged ones are replaced.
    fn change(&self, change: impl FnOnce(&mut Marks)) -> Result<(), Error> {
        let mut marks = Marks::read(&self.path).unwrap_or_else(|error| {
            out::note(&format!("{} {error:#}; it is written anew", out::yellow("warning:")));
            Marks { pinned: true, ..Marks::default() }
        });
        change(&mut marks);
        Ok(marks.write(&self.path)?)
    }
}

/// Pins a run.
pub(crate) fn pin(global: &Global, args: &PinArgs) -> Result<Exit, Error> {
    // No cleaning may remove the run meanwhile.
    let _store = global.store_to_read()?;
    let run = Marked::find(global, &args.run)?;
    run.change(|marks| {
        marks.pinned = true;
        marks.note = args.note.clone().or(marks.note.take());
    })?;
    out::line(&format!("pinned {}; `carl-pipe gc` keeps it", run.id));
    Ok(Exit::Ok)
}

/// Takes the pin of a run away.
pub(crate) fn unpin(global: &Global, args: &UnpinArgs) -> Result<Exit, Error> {
    let _store = global.store_to_read()?;
    let run = Marked::find(global, &args.run)?;
    let mut tags = Vec::new();
    run.change(|marks| {
        marks.pinned = false;
        tags.clone_from(&marks.tags);
    })?;
    let kept =
        if tags.is_empty() { String::new() } else { format!("; its tag `{}` still keeps it", tags.join("`, `")) };
    out::line(&format!("unpinned {}{kept}", run.id));
    Ok(Exit::Ok)
}

/// Gives a run a tag, or takes it away.
pub(crate) fn tag(global: &Global, args: &TagArgs) -> Result<Exit, Error> {
    let _store = global.store_to_read()?;
    let run = Marked::find(global, &args.run)?;
    let name = args.name.as_deref().unwrap_or_default();
    if args.remove {
        run.change(|marks| marks.tags.retain(|tag| !name.is_empty() && tag != name))?;
        out::line(&format!(
            "{} has no tag{}",
            run.id,
            if name.is_empty() { String::new() } else { format!(" `{name}`") }
        ));
        return Ok(Exit::Ok);
    }
    if let Some(why) = why_no_tag(name) {
        return Err(Error::usage(format!("`{name}` cannot be a tag: {why}")).help("such as `best` or `paper-v2`"));
    }
    let all = global.runs();
    if runs::list(&all)?.iter().any(|other| runs::pipeline_of(&all.join(&other.id)).as_deref() == Some(name)) {
        return Err(Error::usage(format!("`{name}` cannot be a tag: it is the name of a pipeline"))
            .help(format!("`{name}` already finds the newest run of that pipeline")));
    }
    // First the new, then the old, so that a kill loses no tag.
    run.change(|marks| {
        if !marks.tags.iter().any(|tag| tag == name) {
            marks.tags.push(name.to_owned());
        }
    })?;
    let from = take_from_others(&all, &run.id, name)?;
    out::line(&format!("{} is now `{name}`{from}", run.id));
    Ok(Exit::Ok)
}

/// Takes a tag from all other runs; says from which.
fn take_from_others(all: &Path, id: &str, name: &str) -> Result<String, Error> {
    let mut from = String::new();
    for other in runs::list(all)?.iter().filter(|other| other.id != id) {
        let path = all.join(&other.id);
        if let Ok(mut marks) = Marks::read(&path)
            && marks.tags.iter().any(|tag| tag == name)
        {
            marks.tags.retain(|tag| tag != name);
            marks.write(&path)?;
            from = format!(", and {} is no more", other.id);
        }
    }
    Ok(from)
}
