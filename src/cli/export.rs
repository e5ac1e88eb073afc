//! `carl-pipe export`: writes the arrays of a node's output as one `.npz` file, which NumPy opens.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};

use super::{
    Global,
    exit::{Error, Exit},
    finished_node::{files, finished},
    out,
    output::refuse_inputs,
};
use crate::{
    arrays::{self, Arrays as _, NpzWriter},
    artifact::Files,
    store::Content,
};

/// The arguments of `export`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The run: `latest`, `latest~1`, a tag, a pipeline (its newest run), a run id, or the beginning of an id.
    #[arg(value_name = "RUN")]
    run: String,
    /// The node, or a stage for its last node.
    #[arg(value_name = "NODE")]
    node: String,
    /// The file to write.
    #[arg(short, long, value_name = "FILE.npz")]
    output: PathBuf,
}

/// Exports a node.
pub(crate) fn export(global: &Global, args: &Args) -> Result<Exit, Error> {
    let manifest = global.manifest(&args.run)?;
    let node = finished(&manifest, &args.node)?;
    if args.output.extension().is_none_or(|ending| ending != "npz") {
        return Err(Error::usage(format!("{} does not end in `.npz`", args.output.display())));
    }
    refuse_inputs(&args.output, &[], &global.artifacts).map_err(|error| Error::usage(error.to_string()))?;
    let files = files(global, node)?;
    let names = write(&files, &args.output)
        .with_context(|| format!("cannot export `{}` to {}", node.about.name, args.output.display()))?;
    out::line(&format!("{}: {}", args.output.display(), names.join(", ")));
    Ok(Exit::Ok)
}

/// Writes the tensors of all files, one at a time. With several files of tensors, names begin with that of the file.
fn write(files: &Files, output: &Path) -> anyhow::Result<Vec<String>> {
    let of_tensors = files.iter().filter_map(|(name, content)| Some((name.strip_suffix(".safetensors")?, content)));
    let of_tensors: Vec<(&str, &Content)> = of_tensors.collect();
    if of_tensors.is_empty() {
        let names: Vec<&str> = files.names().collect();
        bail!("it has no arrays, only {}", names.join(", "));
    }
    let folder = output.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut file = tempfile::NamedTempFile::new_in(folder)?;
    let mut npz = NpzWriter::new(&mut file);
    let mut names = Vec::new();
    for (stem, content) in &of_tensors {
        let tensors = arrays::safetensors(content)?;
        for name in tensors.names() {
            let array = tensors.read(&name)?;
            let name = if of_tensors.len() > 1 { format!("{stem}/{name}") } else { name };
            npz.add(&name, array.dtype, &array.shape, &array.bytes)?;
            names.push(format!("{name} {} {:?}", array.dtype, array.shape));
        }
    }
    npz.finish()?;
    file.persist(output)?;
    Ok(names)
}
