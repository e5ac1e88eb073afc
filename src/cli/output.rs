//! Refuses to write to a file that is read, under whatever name.

use std::{
    fs::{self, Metadata},
    os::unix::fs::MetadataExt as _,
    path::{Path, PathBuf},
};

use anyhow::bail;

/// Refuses an output that is the same file as an input, or a file of the store at `artifacts` that no user wrote. Links
/// are followed.
///
/// # Errors
/// The output must not be written.
pub(crate) fn refuse_inputs(output: &Path, inputs: &[PathBuf], artifacts: &Path) -> anyhow::Result<()> {
    let Ok(here) = fs::metadata(output) else { return Ok(()) }; // Nothing is there yet.
    let is_same = |input: &&PathBuf| fs::metadata(input).is_ok_and(|there| is_same_file(&here, &there));
    if let Some(input) = inputs.iter().find(is_same) {
        bail!("`{}` is the input {}; choose another output", output.display(), input.display());
    }
    if is_of_store(output, &here, artifacts) {
        bail!("`{}` belongs to the store {}; choose another output", output.display(), artifacts.display());
    }
    Ok(())
}

fn is_same_file(one: &Metadata, other: &Metadata) -> bool {
    (one.dev(), one.ino()) == (other.dev(), other.ino())
}

/// Whether a file lies in a folder that only the store writes, or is another name of such a file.
fn is_of_store(output: &Path, meta: &Metadata, artifacts: &Path) -> bool {
    let (Ok(path), Ok(store)) = (output.canonicalize(), artifacts.canonicalize()) else { return false };
    let Ok(inside) = path.strip_prefix(&store) else { return false };
    !inside.starts_with("runs") || meta.nlink() > 1
}

/// The files that show a run: its manifest, its events and its recordings.
pub(crate) fn files_of_run(run_dir: &Path) -> Vec<PathBuf> {
    let in_folder = |folder: PathBuf| fs::read_dir(folder).into_iter().flatten().flatten().map(|item| item.path());
    in_folder(run_dir.to_owned()).chain(in_folder(run_dir.join("live"))).collect()
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::symlink;

    use super::*;

    #[test]
    fn a_file_is_known_under_every_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        fs::create_dir_all(path("store/objects")).unwrap();
        for file in ["input", "other", "store/objects/ab"] {
            fs::write(path(file), "").unwrap();
        }
        symlink("input", path("soft")).unwrap();
        fs::hard_link(path("input"), path("hard")).unwrap();
        symlink("store/objects/ab", path("to-object")).unwrap();
        let refused = |name: &str| refuse_inputs(&path(name), &[path("input")], &path("store")).is_err();
        assert!(["input", "soft", "hard", "./input", "to-object", "store/objects/ab"].into_iter().all(refused));
        assert!(!refused("other") && !refused("new") && !refused("store/runs"));
    }
}
