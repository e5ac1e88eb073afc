//! `carl-pipe init`: writes a commented pipeline to start from.

use std::{fs, path::PathBuf};

use super::{
    exit::{Error, Exit},
    out,
};

/// The arguments of `init`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The folder to write to; it is made if it does not exist.
    #[arg(value_name = "DIR", default_value = ".", value_hint = clap::ValueHint::DirPath)]
    folder: PathBuf,
    /// What to start from.
    #[arg(long, value_name = "START", value_enum, default_value_t = Start::PlanarOnline)]
    from: Start,
}

/// What a pipeline can start from.
#[derive(Debug, Clone, Copy, clap::ValueEnum)]
#[value(rename_all = "snake_case")]
enum Start {
    /// Online CARL on the planar task: every stage, with its parameters.
    PlanarOnline,
    /// An environment of Gymnasium as the task.
    Gymnasium,
    /// A program of your own between stages of carl-pipe.
    Command,
}

impl Start {
    /// The files by name.
    fn files(self) -> &'static [(&'static str, &'static str)] {
        match self {
            Self::PlanarOnline => &[("pipeline.toml", include_str!("../../pipelines/planar_online.toml"))],
            Self::Gymnasium => &[
                ("pipeline.toml", include_str!("../../examples/gymnasium/pendulum.toml")),
                ("my_env.py", include_str!("../../examples/gymnasium/my_env.py")),
            ],
            Self::Command => &[
                ("pipeline.toml", include_str!("../../examples/command/pipeline.toml")),
                ("speckle.py", include_str!("../../examples/command/speckle.py")),
            ],
        }
    }
}

/// Writes the files. A file that is there already stays, and nothing is written.
pub(crate) fn init(args: &Args) -> Result<Exit, Error> {
    let files = args.from.files().iter().map(|(name, text)| (args.folder.join(name), text));
    let files: Vec<(PathBuf, &&str)> = files.collect();
    if let Some((path, _)) = files.iter().find(|(path, _)| path.exists()) {
        let error = Error::usage(format!("{} exists already", path.display()));
        return Err(error.help("name another folder"));
    }
    let cannot_write =
        |path: &PathBuf, error| Error::new(Exit::Store, format!("cannot write {}: {error}", path.display()));
    fs::create_dir_all(&args.folder).map_err(|error| cannot_write(&args.folder, error))?;
    for (path, text) in &files {
        fs::write(path, text).map_err(|error| cannot_write(path, error))?;
        out::line(&path.display().to_string());
    }
    out::line(&format!("next: carl-pipe run {}", files[0].0.display()));
    Ok(Exit::Ok)
}
